// The session's clock in the bar: the time, pause, speed, jumps; of a recording its length, and back. Words and steps as in the window
// (client/viewer/clock_bar.h). Whoever sets it has it only for that moment: everybody may drive it.

import type { ClockSet, ClockTold, MemberTold, WorldTold } from '../messages';
import { element } from './notices';
import { nameOf } from './people';

const SLOWEST = 0.25, FASTEST = 16; // session seconds a second
const SKIP = 10e6, LATEST = 2 ** 53 - 1; // microseconds

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
  private world: WorldTold | undefined;
  private rate = 1; // that it runs at, or goes on with
  private driver = ''; // who else has it
  private isHeld = false; // the slider
  private asked = 0; // ClockSet.number
  private answered = 0;

  constructor(private readonly on: { set: (set: ClockSet) => void; say: (sentence: string) => void; isConnected: () => boolean }) {
    const { slider, bar } = this;
    for (const [id, act] of Object.entries({ 'clock-back': () => this.rewind(), 'clock-pause': () => this.toggle(), 'clock-ahead': () => this.skip(), slower: () => this.slower(), faster: () => this.faster() }))
      element(id).addEventListener('click', act);
    slider.addEventListener('input', () => (this.isHeld = true));
    slider.addEventListener('change', () => {
      this.isHeld = false;
      this.moveTo(Number(slider.value) * 1e6);
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

  enter(world: WorldTold): void {
    if (this.world?.session !== world.session) this.told = undefined;
    this.world = world;
    this.answered = this.asked; // or lost with the connection
  }
  set(told: ClockTold, others: MemberTold[]): void {
    const isFirst = this.told === undefined;
    this.answered = Math.max(this.answered, told.answers);
    // Until the server has heard all that was set, what it says of that may be older.
    this.told = this.told && this.answered < this.asked ? { ...this.told, end: told.end, owner: told.owner } : told;
    this.rate = this.told.rate || this.rate;
    const owner = others.find(({ camera }) => camera === told.owner);
    this.driver = told.owner === '0' || told.owner === this.world?.camera ? '' : owner ? nameOf(owner) : `Member ${told.owner}`;
    if (isFirst) this.show(told.end > 0); // whoever looks at a recording wants it
  }

  get time(): number {
    const { told } = this;
    if (!told) return 0;
    const time = told.time + (performance.timeOrigin + performance.now() - told.at) * 1e3 * told.rate;
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
    const jumps = this.world?.jumpsClock === true, isRecording = told.end > 0;
    this.say('clock-time', clockText(this.isHeld ? Number(slider.value) * 1e6 : time) + (isRecording ? ` / ${clockText(told.end)}` : ''));
    this.say('clock-pause', this.isOver ? 'Again' : told.rate > 0 ? 'Pause' : 'Resume');
    this.say('clock-rate', `${this.rate} x`);
    this.say('clock-driver', this.driver ? `${this.driver} owns it` : '');
    slider.hidden = element('clock-back').hidden = !isRecording || !jumps;
    element('clock-ahead').hidden = !jumps;
    slider.max = String(told.end / 1e6);
    if (!this.isHeld) slider.value = String(time / 1e6);
    slider.setAttribute('aria-valuetext', clockText(Number(slider.value) * 1e6));
    for (const control of this.driven) control.disabled = this.driver !== '';
  }

  // By keys only while the clock is shown: it is everybody's.
  toggle(): void {
    if (this.isOver) this.drive(this.rate, 1);
    else this.drive(this.told?.rate === 0 ? this.rate : 0, 0);
  }
  slower(): void {
    this.setRate(this.rate / 2);
  }
  faster(): void {
    this.setRate(this.rate * 2);
  }
  rewind(): void {
    this.moveTo(this.time - SKIP);
  }
  skip(): void {
    this.moveTo(this.time + SKIP);
  }

  private get isOver(): boolean {
    return this.told !== undefined && this.told.end > 0 && this.time >= this.told.end;
  }
  private setRate(rate: number): void {
    const bounded = Math.min(FASTEST, Math.max(SLOWEST, rate)), stands = this.told?.rate === 0;
    if (this.drive(stands ? 0 : bounded, 0)) this.rate = bounded;
  }
  private moveTo(time: number): void {
    const end = this.told?.end || LATEST;
    this.drive(this.told?.rate ?? 0, Math.round(Math.min(end, Math.max(1, time))));
  }
  /** Whether it is asked for. */
  private drive(rate: number, time: number): boolean {
    const { told, driver, world } = this;
    if (!this.isShown || !told) return false;
    const why = driver ? `${driver} owns the clock` : !this.on.isConnected() ? 'No connection to a server with a clock.' : time > 0 && !world?.jumpsClock ? 'This server is too old to set its clock to a time.' : '';
    if (why) return this.on.say(why), false;
    // So that the next key, which may be pressed before the server answers, goes on from there.
    this.told = { ...told, rate, time: time || this.time, at: performance.timeOrigin + performance.now() };
    this.on.set({ rate, time, number: ++this.asked });
    return true;
  }
  private say(id: string, text: string): void {
    if (element(id).textContent !== text) element(id).textContent = text;
  }
}
