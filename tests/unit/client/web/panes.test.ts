// What the panes draw of a flight that stops, on simulated cards of many speeds, in simulated time.

import assert from 'node:assert/strict';
import { test } from 'node:test';
import type { Look } from '../../../../client/web/src/messages';
import type { Rectangle } from '../../../../client/web/src/render/full_screen';
import { MarchPane, MeshPane, Pane, Tools } from '../../../../client/web/src/render/panes';
import { View, ViewUniforms } from '../../../../client/web/src/render/view';

const FRAME = 16, KNOWN = 33; // ms: of the page, and until it knows that the camera rests
const LOOK: Look = { mode: 'mesh', divider: 0.5, wireframe: false, nodes: false, candidates: false, corrected: true };

/** A graphics card: the milliseconds that it takes for a mesh, and for a sample of each kind. */
class Card {
  now = 0;
  longest = 0; // portion
  private owed = 0;
  constructor(
    private readonly mesh: number,
    private readonly shading: number,
    private readonly march: number,
  ) {}

  readonly tools = ((): Tools => {
    const program = (each: () => number) => ({
      run: (_renderer: unknown, _target: unknown, { width, height }: Rectangle) => void (this.owed += width * height * each()),
    });
    const own = new Proxy({}, { get: () => ({ value: undefined }) });
    const shade = program(() => this.shading), march = program(() => this.march), skyline = program(() => this.march / 100);
    return {
      renderer: { capabilities: { maxTextureSize: 8192 } },
      uniforms: new ViewUniforms(),
      programs: { isNeutral: false, own, shade, march, skyline },
      edits: { version: 0 },
      leaves: { version: 1, draw: () => void (this.owed += this.mesh) },
      canCorrect: false,
    } as unknown as Tools;
  })();

  /** Draws a portion; false: there was nothing to do, and a frame passes. */
  step(pane: Pane, view: View): boolean {
    const portion = pane.step(this.tools, view, LOOK, this.now), took = portion ? this.owed : FRAME;
    this.owed = 0;
    this.now += took;
    if (!portion) return false;
    pane.measured(portion, took);
    this.longest = Math.max(this.longest, took);
    return true;
  }
}

const pose = { z: 0, remainderX: 0, remainderZ: 0, y: 100, yaw: 0, pitch: -0.2 };
const viewAt = (x: number, rests: boolean): View => ({ pose: { ...pose, x }, width: 1280, height: 720, verticalFov: 1, horizon: 2e4, rests });

/** Flies, stops, and waits for a picture of where the camera stands, with blocks of at most 4 x 4 pixels: in ms, and when it could be there
 *  at the latest: a card that is told of the rest finishes its portion and then draws that picture alone. */
function stopping(make: () => Pane, card: Card, stop: number): { after: number; atLatest: number } {
  const pane = make(), at = (now: number): View => viewAt(Math.floor(Math.min(now, stop) / FRAME), now >= stop + KNOWN);
  while (card.now < stop) card.step(pane, at(card.now));
  while (pane.coarseness > 4 || pane.shownView!.pose.x !== at(stop).pose.x) {
    card.step(pane, at(card.now));
    assert.ok(card.now < stop + 60_000, 'no such picture');
  }
  const after = card.now - stop, portion = card.longest, alone = Object.assign(make(), { coarseness: 4 }), began = card.now;
  while (!alone.shown) card.step(alone, viewAt(0, true));
  return { after, atLatest: KNOWN + FRAME + portion + (card.now - began) };
}

for (const [name, make] of [
  ['mesh', () => new MeshPane()],
  ['ray march', () => new MarchPane()],
] as const)
  test(`who stops sees blocks of 4 x 4 pixels, of the ${name}, as soon as the card can draw them`, () => {
    for (const speed of [1, 3, 10, 30, 100])
      for (let stop = 3000; stop < 3400; stop += 7) {
        const { after, atLatest } = stopping(make, new Card(3 * speed, 1e-4 * speed, 5e-4 * speed), stop);
        assert.ok(after <= atLatest, `card ${speed}, stopped at ${stop} ms: ${after.toFixed(0)} ms, not ${atLatest.toFixed(0)}`);
      }
  });
