// Who is in the session: one's own name, which this browser remembers, and the others, each a button that flies there.

import type { MemberTold } from '../messages';
import { Pose, distanceTo } from '../render/view';
import { memberColour } from '../render/colours';
import { element } from './notices';
import { remember, remembered } from './memory';
import { Panel } from './panel';

const UNNAMED = 'ridgecast-web'; // core::nameOf() calls it a guest

export const distanceText = (metres: number): string => (metres < 1000 ? `${Math.round(metres)} m` : `${(metres / 1000).toLocaleString('en', { maximumFractionDigits: 1 })} km`);

export class People {
  private readonly panel = new Panel('who');
  private readonly field = element('own-name').querySelector('input')!;
  private others: MemberTold[] = [];
  private count = 0; // of all others, named or not

  constructor(private readonly on: { fly: (to: NonNullable<MemberTold['at']>) => void; renamed: () => void }) {
    this.field.value = remembered('name');
    this.field.addEventListener('change', () => this.rename(this.field.value));
    this.field.addEventListener('keydown', (event) => {
      if (event.key === 'Escape') this.field.value = remembered('name');
    });
    element('own-name').addEventListener('submit', (event) => {
      event.preventDefault();
      this.field.blur(); // which changes it
    });
  }

  /** What the others see. */
  get ownName(): string {
    return this.field.value || UNNAMED;
  }
  /** Of a link; empty: none. */
  take(name: string): void {
    if (name) this.rename(name);
  }

  set(others: MemberTold[], count: number): void {
    this.others = others;
    this.count = count;
    element('people').textContent = count === 0 ? 'only you' : `${count + 1} here`;
  }

  toggle(pose: Pose): void {
    if (this.panel.toggle()) this.list(pose);
  }
  /** Keeps what is shown up to date. */
  draw(pose: Pose): void {
    if (this.panel.isOpen) this.list(pose);
  }

  /** The nearest first. */
  private list(pose: Pose): void {
    const list = element('others'), away = (m: MemberTold): number => (m.at ? distanceTo(pose, m.at) : Infinity);
    const members = [...this.others].sort((a, b) => away(a) - away(b));
    list.hidden = members.length === 0;
    element('alone').hidden = this.count > 0;
    element('farther').hidden = this.count <= members.length;
    element('farther').textContent = `and ${(this.count - members.length).toLocaleString('en')} farther away`;
    while (list.childElementCount > members.length) list.lastElementChild!.remove();
    members.forEach((member, k) => this.fill((list.children[k] as HTMLElement | undefined) ?? list.appendChild(document.createElement('li')), member, away(member)));
  }

  private fill(item: HTMLElement, member: MemberTold, metres: number): void {
    const text = `${member.name}${Number.isFinite(metres) ? ` · ${distanceText(metres)}` : ''}`;
    if (item.dataset['of'] === member.camera && item.textContent === text) return;
    item.dataset['of'] = member.camera;
    const button = item.querySelector('button') ?? item.appendChild(document.createElement('button')), dot = document.createElement('i');
    dot.style.background = memberColour(member.camera);
    button.replaceChildren(dot, text);
    button.title = 'Fly there';
    button.disabled = !member.at;
    button.onclick = () => {
      this.panel.close();
      if (member.at) this.on.fly(member.at);
    };
  }

  private rename(name: string): void {
    this.field.value = name.replace(/[\u0000-\u001f\u007f-\u009f]/g, '').trim().slice(0, this.field.maxLength);
    if (this.field.value === remembered('name')) return;
    remember('name', this.field.value);
    this.on.renamed();
  }
}
