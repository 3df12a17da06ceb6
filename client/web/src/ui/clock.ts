// The session's clock in the bar: the time, pause, speed, jumps; of a recording its length, and back. What they do is in client/core/hands.

import type { ClockTold, Drive, WorldTold } from '../messages';
import { element } from './notices';

const LATEST = 2 ** 53 - 1; // microseconds

/** "1:02.3", "1:00:02.3"; tenths, rounded down. */
export function clockText(microseconds: number): string {
  const tenths = Math.floor(microseconds / 1e5), minutes = Math.floor(tenths / 600), two = (n: number): string => String(n).padStart(2, '0');
  const seconds = `${two(Math.floor(tenths / 10) % 60)}.${tenths % 10}`;
  return minutes < 60 ? `${minutes}:${seconds}` : `${Math.floor(minutes / 60)}:${two(minutes % 60)}:${seconds}`;
}

export class Clock {
  private readonly bar = element('clock');
  private readonly slider = element<HTMLInputElement>('clock-slider');
  private readonly driven = this.bar.querySelectorAll<HTMLButtonElement | HTMLInputElement>('button, input');
  private told: ClockTold | undefined;
  private session = '';
  private isHeld = false; // the slider

  constructor(private readonly engine: (drive: Drive, to: number) => void) {
    const { slider, bar } = this;
    for (const [id, act] of Object.entries({ 'clock-back': () => this.rewind(), 'clock-pause': () => this.toggle(), 'clock-ahead': () => this.skip(), slower: () => this.slower(), faster: () => this.faster() }))
      element(id).addEventListener('click', act);
    slider.addEventListener('input', () => (this.isHeld = true));
    slider.addEventListener('change', () => {
      this.isHeld = false;
      this.drive('to', Number(slider.value) * 1e6);
    });
    slider.addEventListener('keydown', (event) => {
      const ways: Record<string, () => void> = { ArrowLeft: () => this.rewind(), ArrowRight: () => this.skip() };
      if (!event.key.startsWith('Arrow')) return;
      event.preventDefault();
      event.stopPropagation(); // they do not look around
      ways[event.key]?.();
    });
    // Who clicks goes on flying; keys keep the focus where it is.
    bar.addEventListener('click', (event) => event.detail > 0 && element('view').focus({ preventScroll: true }));
  }

  enter({ session }: WorldTold): void {
    if (this.session !== session) this.told = undefined;
    this.session = session;
  }
  set(told: ClockTold): void {
    const isFirst = this.told === undefined;
    this.told = told;
    if (isFirst) this.show(told.end > 0); // whoever looks at a recording wants it
  }

  get time(): number {
    const { told } = this;
    if (!told) return 0;
    const time = told.time + (told.runs ? (performance.timeOrigin + performance.now() - told.at) * 1e3 * told.rate : 0);
    return Math.min(told.end > 0 ? told.end : LATEST, Math.max(told.time, time));
  }
  get isShown(): boolean {
    return !this.bar.hidden;
  }

  show(shown: boolean): void {
    this.bar.hidden = !shown;
    element('timing').setAttribute('aria-pressed', String(shown));
    document.documentElement.classList.toggle('timed', shown);
  }
  /** Once a frame. */
  draw(): void {
    const { told, slider, time } = this;
    if (!this.isShown || !told) return;
    const { jumps, driver } = told, isRecording = told.end > 0;
    this.say('clock-time', clockText(this.isHeld ? Number(slider.value) * 1e6 : time) + (isRecording ? ` / ${clockText(told.end)}` : ''));
    this.say('clock-pause', isRecording && time >= told.end ? 'Again' : told.runs ? 'Pause' : 'Resume');
    this.say('clock-rate', `${told.rate} x`);
    this.say('clock-driver', driver ? `${driver} owns it` : '');
    slider.hidden = element('clock-back').hidden = !isRecording || !jumps;
    element('clock-ahead').hidden = !jumps;
    slider.max = String(told.end / 1e6);
    if (!this.isHeld) slider.value = String(time / 1e6);
    slider.setAttribute('aria-valuetext', clockText(Number(slider.value) * 1e6));
    for (const control of this.driven) control.disabled = driver !== '';
  }

  toggle(): void {
    this.drive('toggle');
  }
  slower(): void {
    this.drive('slower');
  }
  faster(): void {
    this.drive('faster');
  }
  rewind(): void {
    this.drive('back');
  }
  skip(): void {
    this.drive('ahead');
  }

  // By keys only while the clock is shown: it is everybody's.
  private drive(drive: Drive, to = 0): void {
    if (this.isShown && this.told) this.engine(drive, to);
  }
  private say(id: string, text: string): void {
    if (element(id).textContent !== text) element(id).textContent = text;
  }
}
