// The edit mode of the page: a brush on the ground below the pointer, or in the middle of the picture where there is none, the tools in the
// bar, and what is told to the engine. What they do is in editing.ts.

import type { Place, ToEngine, Touched, WorldTold } from '../messages';
import { samePose } from '../render/view';
import { Editing, Tool } from './editing';
import type { Hands } from './hands';
import { element } from './notices';
import { Frame, pathOf, towards } from './outline';

const STILL = 6; // pixels that a click may move

interface Tap {
  x: number;
  y: number;
}
/** What becomes of the place that the engine is asked for. */
type Purpose = 'show' | 'use' | 'end';

const newKey = (): string => Array.from(crypto.getRandomValues(new Uint8Array(16)), (byte) => byte.toString(16).padStart(2, '0')).join('');

export class Editor {
  on = false;
  private readonly editing: Editing;
  private readonly bar = element('edit');
  private readonly tools = this.bar.querySelectorAll<HTMLButtonElement>('[data-tool]');
  private pointer: Tap | undefined; // over the picture
  private pressed: Tap | undefined;
  private frame: Frame | undefined; // the last
  private touched: Touched | undefined;
  private asked = 0;
  private readonly waiting: Purpose[] = []; // of what was asked and not answered, in its order
  private shown = ''; // what the last brush was asked for

  constructor(
    private readonly canvas: HTMLCanvasElement,
    private readonly hands: Hands,
    private readonly to: { engine: (message: ToEngine) => void; say: (sentence: string) => void },
  ) {
    this.editing = new Editing({ send: (edit) => to.engine({ kind: 'edit', ...edit }), say: to.say, newKey });
    for (const button of this.tools) button.addEventListener('click', () => this.act(() => this.editing.choose(button.dataset['tool'] as Tool)));
    const material = element<HTMLSelectElement>('material');
    material.addEventListener('change', () => {
      this.editing.material = material.value;
      canvas.focus({ preventScroll: true });
    });
    for (const [id, act] of Object.entries({ narrower: () => this.widen(-1), wider: () => this.widen(1), here: () => this.ask('use', this.at), 'end-road': () => this.endRoad(), undo: () => this.undo() }))
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
    this.editing.rest();
    this.show(false);
  }

  connected({ session }: WorldTold): void {
    this.editing.connected(session);
  }
  answered(id: number, number: number, refusal: string): void {
    this.act(() => this.editing.hear(id, number, refusal));
  }

  touch(touched: Touched | undefined): void {
    const purpose = this.waiting.shift();
    if (!this.on) return;
    this.touched = touched;
    if (purpose === 'use' && !touched) this.to.say('There is no ground.');
    if (purpose === 'use' && touched) this.act(() => this.editing.use(touched.at));
    if (purpose === 'end') this.act(() => this.editing.endRoad());
  }

  widen(notches: number): void {
    if (this.on) this.act(() => this.editing.widen(notches));
  }
  undo(): void {
    if (this.on) this.act(() => this.editing.undo());
  }
  /** With the clicks before it. */
  endRoad(): void {
    if (this.on) this.ask('end', this.at);
  }

  /** `changes`: of the mesh. */
  draw(frame: Frame, changes: number): void {
    const hasMoved = !this.frame || !samePose(this.frame.pose, frame.pose) || this.frame.width !== frame.width || this.frame.height !== frame.height;
    this.frame = frame;
    if (!this.on) return;
    const { at, editing } = this, wanted = `${at.x} ${at.y} ${editing.radius} ${editing.line.length} ${editing.tool} ${changes}`;
    if ((hasMoved || wanted !== this.shown) && this.waiting.length === 0) {
      this.shown = wanted;
      this.ask('show', at);
    }
    const outline = this.touched ? pathOf(this.touched.outline, frame, true) : '', line = this.touched ? pathOf(this.touched.line, frame, false) : '';
    for (const path of element('brush').querySelectorAll('path')) path.setAttribute('d', outline + line);
  }

  /** Where the brush is, in the window. */
  private get at(): Tap {
    return this.pointer ?? { x: innerWidth / 2, y: innerHeight / 2 };
  }

  private ask(purpose: Purpose, { x, y }: Tap): void {
    const { frame, editing } = this;
    if (!frame) return;
    this.waiting.push(purpose);
    const line: readonly Place[] = editing.tool === 'road' ? editing.line : [];
    this.to.engine({ kind: 'brush', brush: { number: ++this.asked, from: frame.pose, towards: towards(frame, x, y), radius: editing.radius, line } });
  }

  private act(what: () => void): void {
    what();
    this.show(this.on);
  }

  private show(on: boolean): void {
    const { editing } = this;
    this.on = on;
    this.hands.onWheel = on ? (notches) => this.widen(notches) : undefined;
    this.canvas.classList.toggle('edited', on);
    element('editing').setAttribute('aria-pressed', String(on));
    this.bar.hidden = !on;
    document.documentElement.classList.toggle('edits', on);
    if (!on) this.touched = undefined;
    element('brush').toggleAttribute('hidden', !on);
    for (const button of this.tools) button.setAttribute('aria-pressed', String(button.dataset['tool'] === editing.tool));
    element('brush-words').textContent = editing.words;
    element<HTMLButtonElement>('undo').disabled = !editing.mayUndo;
    element('end-road').hidden = editing.tool !== 'road';
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
      if (pressed && isClick(event) && Math.hypot(event.clientX - pressed.x, event.clientY - pressed.y) <= STILL) this.ask('use', { x: event.clientX, y: event.clientY });
    });
    canvas.addEventListener('dblclick', () => this.endRoad());
  }
}
