// Keyboard, mouse and fingers -> Input. Keeps what is held down; pointers on the canvas look around, the stick and two buttons fly.

import { Input, atRest } from './flying';

const SPEED_KEYS: Record<string, number> = { '+': 2, '=': 2, '-': -2 }; // notches of the wheel
const FASTER = 4; // notches that a tap on the buttons for speed is worth: twice as fast
const LOOK_KEYS = 500; // pixels a second that an arrow key is worth

export class Hands {
  /** Whether the key did something. */
  onKey: (code: string, repeated: boolean) => boolean = () => false;
  /** Takes the wheel, and the double click, for something else than flying. */
  onWheel: ((notches: number) => void) | undefined;
  private readonly held = new Set<string>();
  private readonly pointers = new Map<number, { x: number; y: number }>();
  private turnX = 0;
  private turnY = 0;
  private wheel = 0;
  private pinch = 0;
  private stick = { x: 0, y: 0 };
  private lift = 0;

  constructor(private readonly canvas: HTMLCanvasElement) {
    window.addEventListener('keydown', (event) => {
      const target = event.target as HTMLElement;
      const typing = target.closest('input:not([type=range]), select, textarea') && !target.closest('dialog:not([open])'); // a closed one may keep the focus
      if (typing || event.ctrlKey || event.metaKey || event.altKey) return;
      if ((event.code === 'Space' || event.code === 'Enter') && target.closest('button, a, summary')) return; // it presses that
      if (this.onKey(event.code, event.repeat)) event.preventDefault(); // it is not typed into what it opened
      if (event.key in SPEED_KEYS) this.wheel += SPEED_KEYS[event.key]!;
      this.held.add(event.code);
      if (event.code.startsWith('Arrow') || event.code === 'Space') event.preventDefault();
    });
    window.addEventListener('keyup', (event) => this.held.delete(event.code));
    window.addEventListener('blur', () => this.held.clear());
    canvas.addEventListener('pointerdown', (event) => {
      canvas.focus({ preventScroll: true });
      canvas.setPointerCapture(event.pointerId);
      canvas.classList.add('held');
      this.pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    });
    canvas.addEventListener('pointermove', (event) => this.move(event));
    for (const kind of ['pointerup', 'pointercancel'] as const)
      canvas.addEventListener(kind, (event) => {
        this.pointers.delete(event.pointerId);
        if (this.pointers.size === 0) canvas.classList.remove('held');
      });
    canvas.addEventListener('dblclick', () => void (this.onWheel ? undefined : (canvas.requestPointerLock() as unknown as Promise<void> | undefined))?.catch(() => {}));
    canvas.addEventListener(
      'wheel',
      (event) => {
        event.preventDefault();
        const notches = -Math.sign(event.deltaY);
        if (this.onWheel) this.onWheel(notches);
        else this.wheel += notches;
      },
      { passive: false },
    );
    canvas.addEventListener('contextmenu', (event) => event.preventDefault());
  }

  /** The stick and the buttons for thumbs. */
  attachTouch(stick: HTMLElement, lift: HTMLElement, pace: HTMLElement): void {
    for (const button of pace.querySelectorAll<HTMLElement>('[data-faster]')) button.addEventListener('click', () => (this.wheel += FASTER * Number(button.dataset['faster'])));
    const knob = stick.firstElementChild as HTMLElement;
    const place = (event: PointerEvent | undefined): void => {
      const box = stick.getBoundingClientRect();
      let x = 0, y = 0;
      if (event) {
        x = (event.clientX - box.left) / (box.width / 2) - 1;
        y = (event.clientY - box.top) / (box.height / 2) - 1;
        const length = Math.hypot(x, y);
        if (length > 1) (x /= length), (y /= length);
      }
      this.stick = { x, y };
      knob.style.transform = `translate(${x * 2.5}rem, ${y * 2.5}rem)`;
    };
    stick.addEventListener('pointerdown', (event) => {
      stick.setPointerCapture(event.pointerId);
      place(event);
    });
    stick.addEventListener('pointermove', (event) => {
      if (stick.hasPointerCapture(event.pointerId)) place(event);
    });
    for (const kind of ['pointerup', 'pointercancel'] as const) stick.addEventListener(kind, () => place(undefined));
    for (const button of lift.querySelectorAll<HTMLElement>('[data-lift]')) {
      button.addEventListener('pointerdown', () => (this.lift = Number(button.dataset['lift'])));
      for (const kind of ['pointerup', 'pointercancel', 'pointerleave'] as const) button.addEventListener(kind, () => (this.lift = 0));
    }
  }

  /** What happened since the last call, which was so long ago. */
  take(seconds: number): Input {
    const input = atRest();
    const key = (...codes: string[]): number => (codes.some((code) => this.held.has(code)) ? 1 : 0);
    const clamp = (v: number): number => Math.max(-1, Math.min(1, v));
    input.forward = clamp(key('KeyW') - key('KeyS') - this.stick.y + clamp(this.pinch / 12));
    input.right = clamp(key('KeyD') - key('KeyA') + this.stick.x);
    input.up = clamp(key('KeyE', 'Space') - key('KeyQ') + this.lift);
    input.sprint = key('ShiftLeft', 'ShiftRight') === 1;
    input.turnX = this.turnX + (key('ArrowRight') - key('ArrowLeft')) * LOOK_KEYS * seconds;
    input.turnY = this.turnY + (key('ArrowDown') - key('ArrowUp')) * LOOK_KEYS * seconds;
    input.wheel = this.wheel;
    this.turnX = this.turnY = this.wheel = this.pinch = 0;
    return input;
  }

  private move(event: PointerEvent): void {
    if (document.pointerLockElement === this.canvas) {
      this.turnX += event.movementX;
      this.turnY += event.movementY;
      return;
    }
    const pointer = this.pointers.get(event.pointerId);
    if (!pointer) return;
    const before = this.spread();
    const dx = event.clientX - pointer.x, dy = event.clientY - pointer.y;
    pointer.x = event.clientX;
    pointer.y = event.clientY;
    if (this.pointers.size > 1) {
      this.pinch += this.spread() - before;
      return;
    }
    const sign = event.pointerType === 'touch' ? -1 : 1; // a finger holds the ground, a mouse turns the head
    this.turnX += sign * dx;
    this.turnY += sign * dy;
  }

  /** Pixels between the first two fingers. */
  private spread(): number {
    const [a, b] = [...this.pointers.values()];
    return a && b ? Math.hypot(a.x - b.x, a.y - b.y) : 0;
  }
}
