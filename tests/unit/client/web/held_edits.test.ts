// What the page holds of edited ground when its connection is lost and another begins.

import assert from 'node:assert/strict';
import { create } from '@bufbuild/protobuf';
import { test } from 'node:test';
import { HeldEdits } from '../../../../client/web/src/engine/held_edits';
import { FoundEditsSchema, SquaresSchema } from '../../../../client/web/src/generated/ridgecast/v1/stream_pb';

/** A session's squares, each raised by so many steps all over. */
class Session {
  readonly raised = new Map<string, number>();
  constructor(public edit: bigint) {}

  /** Answers until nothing more is asked; what the painter is told, by square. */
  answer(held: HeldEdits): Map<string, number | 'gone'> {
    const told = new Map<string, number | 'gone'>();
    for (let k = 0; k < 20; ++k) {
      const { find, want } = held.take();
      const addresses = [...this.raised.keys()].map((key) => key.split(',').map(BigInt)).map(([i, j]) => ({ i: i!, j: j! }));
      const area = { x0: -(2n ** 40n), z0: -(2n ** 40n), x1: 2n ** 40n, z1: 2n ** 40n };
      if (find) held.found(create(FoundEditsSchema, { edit: this.edit, changed: find.since < this.edit ? [area] : [], squares: find.radius > 0 ? addresses : [] }));
      const squares = want.map((address) => ({ address, rises: tileOf(this.raised.get(`${address.i},${address.j}`) ?? 0), materials: new Uint8Array() }));
      if (want.length > 0) held.put(create(SquaresSchema, { edit: this.edit, squares }));
      const { fresh, gone } = held.changes();
      for (const key of gone) told.set(key, 'gone');
      for (const { key, posts } of fresh) told.set(key, posts[77]! / 16);
    }
    assert.ok(held.complete);
    return told;
  }
}

/** All samples alike: the first one's difference from nothing, and a run of zeros. */
const tileOf = (value: number): Uint8Array => (value === 0 ? new Uint8Array() : Uint8Array.of(0x30, 2 * value, 0, 0xfe, 0x7f));

function holding(session: Session): HeldEdits {
  const held = new HeldEdits(8000);
  held.know(session.edit);
  session.answer(held);
  return held;
}

test('what is held stays until the new is there', () => {
  const session = new Session(2n);
  session.raised.set('0,0', 5).set('3,-2', 6).set('1,1', 7);
  const held = holding(session);
  session.edit = 4n;
  session.raised.set('0,0', 9).delete('3,-2');
  held.reconnected(session.edit);
  assert.deepEqual(held.changes(), { fresh: [], gone: [] });
  assert.equal(held.complete, false);
  assert.deepEqual(held.all.sort(), ['0,0', '1,1', '3,-2']);
  const told = session.answer(held);
  assert.deepEqual([...told].sort(), [['0,0', 9], ['1,1', 7], ['3,-2', 'gone']]);
});

test('edits that ended and began anew, with as many as before, are fetched', () => {
  const session = new Session(3n);
  session.raised.set('0,0', 5).set('1,0', 6);
  const held = holding(session), other = new Session(3n);
  other.raised.set('1,0', 8);
  held.reconnected(other.edit);
  assert.deepEqual([...other.answer(held)].sort(), [['0,0', 'gone'], ['1,0', 8]]);
});

test('of a session without edits nothing stays, and what was asked is forgotten', () => {
  const session = new Session(3n);
  session.raised.set('0,0', 5);
  const held = holding(session);
  held.know(4n);
  assert.ok(held.take().find);
  held.reconnected(0n);
  assert.deepEqual(held.changes(), { fresh: [], gone: ['0,0'] });
  assert.ok(held.complete);
  assert.deepEqual(held.take(), { find: undefined, want: [] });
});
