// What a person does to the ground, without a page: the brush and its radius, the corners of a road, edits that wait for their answers,
// and what may be undone. An edit that is not answered goes again over the next connection; by its key it is made once.

import type { Place } from '../messages';
import { STEPS_PER_METRE } from '../render/view';

export type Tool = 'crater' | 'raise' | 'lower' | 'level' | 'smooth' | 'road';

// Metres; common/edits/operation.h. A road is as wide as the brush.
const MOST_RADIUS: Record<Tool, number> = { crater: 256, raise: 256, lower: 256, level: 256, smooth: 64, road: 32 };
const LEAST_RADIUS = 0.5;
const NOTCH = 1.15;
const MOST_CORNERS = 256; // of a road
const MOST_OPEN = 16; // edits without an answer
const MOST_TIMES = 3; // that one is sent
const MOST_UNDONE = 1024; // edits that may be undone
const SAME_CORNER = 0.5; // metres: the second click of a double click

interface Open {
  id: number;
  key: string;
  operation: string;
  times: number;
  undoes: number; // 0: it is no undo
}

export interface To {
  send(edit: { id: number; key: string; operation: string }): void;
  say(sentence: string): void;
  /** Unlike any other, of anybody. */
  newKey(): string;
}

const metres = (steps: number): number => steps / STEPS_PER_METRE;
const toStep = (length: number): number => Math.round(length * STEPS_PER_METRE) / STEPS_PER_METRE;
const apart = (a: Place, b: Place): number => Math.hypot(a.x - b.x, a.z - b.z) / STEPS_PER_METRE;

export class Editing {
  tool: Tool = 'crater';
  radius = 8; // metres
  material = ''; // of the ground that an edit makes; empty: as it is
  private corners: Place[] = [];
  private open: Open[] = [];
  private made: number[] = []; // of one's own, the last last; one that somebody else has undone is found out when it is its turn
  private session = '';
  private ids = 0;

  constructor(private readonly to: To) {}

  /** Of a road that is being drawn. */
  get line(): readonly Place[] {
    return this.corners;
  }
  get mayUndo(): boolean {
    return this.corners.length > 0 || this.made.length > 0;
  }
  /** What the brush does where it is used. */
  get words(): string {
    const { radius } = this, by = (length: number): string => `${Number(length.toPrecision(2))} m`;
    const words: Record<Tool, string> = {
      crater: `${by(this.depth)} deep`,
      raise: `up ${by(this.rise)}`,
      lower: `down ${by(this.rise)}`,
      level: 'at the height of its middle',
      smooth: '',
      road: this.corners.length === 0 ? 'click its corners' : 'double click ends it',
    };
    return [this.tool === 'road' ? `${by(2 * radius)} wide` : `radius ${by(radius)}`, words[this.tool]].filter(Boolean).join(', ');
  }

  choose(tool: Tool): void {
    this.tool = tool;
    this.corners = [];
    this.widen(0);
  }
  widen(notches: number): void {
    this.radius = Math.min(MOST_RADIUS[this.tool], Math.max(LEAST_RADIUS, toStep(this.radius * NOTCH ** notches)));
  }
  /** Leaves a road that was begun. */
  rest(): void {
    this.corners = [];
  }

  use(at: Place): void {
    if (this.tool !== 'road') return void this.ask(this.operationAt(at));
    const last = this.corners.at(-1);
    if (last && apart(last, at) < SAME_CORNER) return;
    if (this.corners.length === MOST_CORNERS) return this.to.say(`A road has at most ${MOST_CORNERS} corners; end it and go on from there.`);
    this.corners.push(at);
  }
  endRoad(): void {
    if (this.tool !== 'road') return;
    if (this.corners.length < 2) return this.to.say('A road has at least two corners: click where it begins, and where it goes.');
    if (this.ask({ op: 'road', line: this.corners.map(({ x, z }) => [metres(x), metres(z)]), width: 2 * this.radius })) this.corners = [];
  }

  /** The last corner of a road that is being drawn, else the last edit of one's own. */
  undo(): void {
    if (!this.corners.pop()) this.undoEdit();
  }
  private undoEdit(): void {
    const edit = this.made.pop();
    if (edit === undefined) return this.to.say('You have no edit to undo.');
    if (!this.ask({ op: 'undo', edit }, edit)) this.made.push(edit);
  }

  hear(id: number, number: number, refusal: string): void {
    const at = this.open.findIndex((edit) => edit.id === id);
    if (at < 0) return; // answered twice
    const [{ undoes }] = this.open.splice(at, 1) as [Open];
    if (number > 0 && undoes === 0) this.made = [...this.made, number].sort((a, b) => a - b).slice(-MOST_UNDONE);
    if (number > 0) return this.to.say(undoes > 0 ? `Edit ${undoes} undone.` : `Edit ${number} made.`);
    if (undoes === 0) return this.to.say(refusal);
    // Somebody else undid it, or nobody can any more: the one before is the last that counts.
    if (/^Edit \d+ (is undone already|was compacted)/.test(refusal)) return this.undoEdit();
    this.made = [...this.made, undoes].sort((a, b) => a - b);
    this.to.say(refusal);
  }

  /** A connection has begun. */
  connected(session: string): void {
    if (session !== this.session) {
      this.open = [];
      this.made = [];
      this.corners = [];
    }
    this.session = session;
    const given = this.open.filter((edit) => edit.times < MOST_TIMES), dropped = this.open.length - given.length;
    this.open = given;
    if (dropped > 0) this.to.say('The connection was lost again and again before an edit was answered; check whether it was made.');
    for (const edit of given) this.send(edit);
  }

  private get depth(): number {
    return Math.max(1 / STEPS_PER_METRE, toStep(this.radius / 3));
  }
  private get rise(): number {
    return toStep(this.radius / 4);
  }

  private operationAt(at: Place): object {
    const { tool, radius } = this, place = { op: tool, x: metres(at.x), z: metres(at.z), radius };
    if (tool === 'crater') return { ...place, depth: this.depth };
    if (tool === 'level') return { ...place, height: toStep(at.y) };
    return tool === 'smooth' ? { ...place, passes: 8 } : { ...place, by: this.rise };
  }

  private ask(operation: object, undoes = 0): boolean {
    if (this.open.length === MOST_OPEN) {
      this.to.say(`The server has not answered ${MOST_OPEN} edits yet; try again in a moment.`);
      return false;
    }
    const whole = undoes === 0 && this.material ? { ...operation, material: this.material } : operation;
    const edit: Open = { id: ++this.ids, key: this.to.newKey(), operation: JSON.stringify(whole), times: 0, undoes };
    this.open.push(edit);
    this.send(edit);
    return true;
  }
  private send(edit: Open): void {
    ++edit.times;
    this.to.send({ id: edit.id, key: edit.key, operation: edit.operation });
  }
}
