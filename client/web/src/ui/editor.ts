// The edit mode of the page: a brush on the ground below the pointer, or in the middle of the picture where there is none, the tools in the
// bar, and what is told to the engine. What they do is in client/core/hands.

import { type Act, type EditingTold, TOOLS, type ToEngine, type Touched, type WorldTold } from '../messages';
import { samePose } from '../render/view';
import type { Hands } from './hands';
import { element } from './notices';
import { Frame, pathOf, towards } from './outline';

const STILL = 6; // pixels that a click may move

interface Tap {
  x: number;
  y: number;
}

export class Editor {
  on = false;
  private readonly bar = element('edit');
  private readonly tools = this.bar.querySelectorAll<HTMLButtonElement>('[data-tool]');
  private pointer: Tap | undefined; // over the picture
  private pressed: Tap | undefined;
  private frame: Frame | undefined; // the last
  private touched: Touched | undefined;
  private told: EditingTold | undefined;
  private waits = 0; // brushes that were not answered
  private shown = ''; // what the last brush was asked for

  constructor(
    private readonly canvas: HTMLCanvasElement,
    private readonly hands: Hands,
    private readonly engine: (message: ToEngine) => void,
  ) {
    for (const button of this.tools) button.addEventListener('click', () => this.act('choose', TOOLS.findIndex((tool) => tool === button.dataset['tool'])));
    const material = element<HTMLSelectElement>('material');
    material.addEventListener('change', () => {
      this.act('paint', material.selectedIndex);
      canvas.focus({ preventScroll: true });
    });
    for (const [id, act] of Object.entries({ narrower: () => this.widen(-1), wider: () => this.widen(1), here: () => this.ask(true, this.at), 'end-road': () => this.endRoad(), undo: () => this.undo() }))
      element(id).addEventListener('click', act);
    // Who clicks goes on flying; keys keep the focus where it is.
    this.bar.addEventListener('click', (event) => event.detail > 0 && event.target !== material && canvas.focus({ preventScroll: true }));
    this.listen();
  }

  /** Why there is no editing, in a sentence; empty: there is. */
  async begin(world: WorldTold | undefined, authorization: Record<string, string>): Promise<string> {
    if (!world) return 'Without a connection to a server, the ground cannot be edited.';
    if (!world.takesEdits) return 'This server is too old for edits of the ground.';
    if ('Authorization' in authorization) {
      // An undo of nothing: refused to all, and to those without the right because of that.
      const answer = await fetch(`./v1/sessions/${encodeURIComponent(world.session)}/edits/0`, { method: 'DELETE', headers: authorization }).catch(() => undefined);
      if (answer?.status === 401 || answer?.status === 403) return (await answer.text()).trim();
    }
    if (document.pointerLockElement) document.exitPointerLock();
    this.show(true);
    return '';
  }
  end(): void {
    this.act('rest');
    this.show(false);
  }

  hear(told: EditingTold): void {
    this.told = told;
    this.shown = '';
    this.show(this.on);
  }
  touch(touched: Touched | undefined): void {
    --this.waits;
    if (this.on) this.touched = touched;
  }

  widen(notches: number): void {
    this.act('widen', notches);
  }
  undo(): void {
    this.act('undo');
  }
  endRoad(): void {
    this.act('end road');
  }

  /** `changes`: of the mesh. */
  draw(frame: Frame, changes: number): void {
    const hasMoved = !this.frame || !samePose(this.frame.pose, frame.pose) || this.frame.width !== frame.width || this.frame.height !== frame.height;
    this.frame = frame;
    if (!this.on) return;
    const { at } = this, wanted = `${at.x} ${at.y} ${changes}`;
    if ((hasMoved || wanted !== this.shown) && this.waits === 0) {
      this.shown = wanted;
      this.ask(false, at);
    }
    const outline = this.touched ? pathOf(this.touched.outline, frame, true) : '', line = this.touched ? pathOf(this.touched.line, frame, false) : '';
    for (const path of element('brush').querySelectorAll('path')) path.setAttribute('d', outline + line);
  }

  /** Where the brush is, in the window. */
  private get at(): Tap {
    return this.pointer ?? { x: innerWidth / 2, y: innerHeight / 2 };
  }

  private ask(uses: boolean, { x, y }: Tap): void {
    const { frame } = this;
    if (!frame) return;
    ++this.waits;
    this.engine({ kind: 'brush', brush: { from: frame.pose, towards: towards(frame, x, y), uses } });
  }

  private act(act: Act, by = 0): void {
    if (this.on) this.engine({ kind: 'act', act, by });
  }

  private show(on: boolean): void {
    const { told } = this, tool = TOOLS[told?.tool ?? 0];
    this.on = on;
    this.hands.onWheel = on ? (notches) => this.widen(notches) : undefined;
    this.canvas.classList.toggle('edited', on);
    element('editing').setAttribute('aria-pressed', String(on));
    this.bar.hidden = !on;
    document.documentElement.classList.toggle('edits', on);
    if (!on) this.touched = undefined;
    element('brush').toggleAttribute('hidden', !on);
    for (const button of this.tools) button.setAttribute('aria-pressed', String(button.dataset['tool'] === tool));
    element('brush-words').textContent = told?.words ?? '';
    element<HTMLButtonElement>('undo').disabled = !told?.mayUndo;
    element('end-road').hidden = tool !== 'road';
  }

  private listen(): void {
    const { canvas } = this;
    const isClick = (event: PointerEvent): boolean => this.on && event.isPrimary && event.button === 0;
    canvas.addEventListener('pointermove', (event) => {
      if (event.isPrimary) this.pointer = { x: event.clientX, y: event.clientY };
    });
    canvas.addEventListener('pointerleave', () => (this.pointer = undefined));
    canvas.addEventListener('pointerdown', (event) => {
      this.pressed = isClick(event) ? { x: event.clientX, y: event.clientY } : undefined; // a second finger makes it none
    });
    canvas.addEventListener('pointerup', (event) => {
      const { pressed } = this;
      this.pressed = undefined;
      if (pressed && isClick(event) && Math.hypot(event.clientX - pressed.x, event.clientY - pressed.y) <= STILL) this.ask(true, { x: event.clientX, y: event.clientY });
    });
    canvas.addEventListener('dblclick', () => this.endRoad());
  }
}
