// The edit mode without a page: what a brush makes, how edits wait for their answers, what an undo undoes, and where a ray meets the mesh.

import assert from 'node:assert/strict';
import { test } from 'node:test';
import type { Place } from '../../../../client/web/src/messages';
import type { Pose } from '../../../../client/web/src/render/view';
import { Editing } from '../../../../client/web/src/ui/editing';
import { pathOf } from '../../../../client/web/src/ui/outline';

interface Sent {
  id: number;
  key: string;
  operation: string;
}

function begin(session = 'default') {
  const sent: Sent[] = [], said: string[] = [];
  let keys = 0;
  const editing = new Editing({ send: (edit) => void sent.push(edit), say: (sentence) => void said.push(sentence), newKey: () => `key ${++keys}` });
  editing.connected(session);
  const operation = (): unknown => JSON.parse(sent.at(-1)!.operation);
  const answer = (number: number, refusal = ''): void => editing.hear(sent.at(-1)!.id, number, refusal);
  return { editing, sent, said, operation, answer };
}
const place = (x: number, z: number, y = 0): Place => ({ x: 256 * x, z: 256 * z, y });

test('each tool makes its operation, in metres', () => {
  const { editing, operation } = begin();
  editing.use(place(10.5, -4));
  assert.deepEqual(operation(), { op: 'crater', x: 10.5, z: -4, radius: 8, depth: Math.round((8 * 256) / 3) / 256 });
  for (const op of ['raise', 'lower'] as const) {
    editing.choose(op);
    editing.use(place(1, 2));
    assert.deepEqual(operation(), { op, x: 1, z: 2, radius: 8, by: 2 });
  }
  editing.choose('level');
  editing.use(place(1, 2, 310.001));
  assert.deepEqual(operation(), { op: 'level', x: 1, z: 2, radius: 8, height: 310 });
  editing.choose('smooth');
  editing.use(place(1, 2));
  assert.deepEqual(operation(), { op: 'smooth', x: 1, z: 2, radius: 8, passes: 8 });
  // Far away too, to the step.
  editing.use({ x: 2 ** 50 - 1, z: 1 - 2 ** 50, y: 0 });
  const { x, z } = operation() as { x: number; z: number };
  assert.deepEqual([x * 256, z * 256], [2 ** 50 - 1, 1 - 2 ** 50]);
});

test('an edit has the material of the brush, an undo has none', () => {
  const { editing, operation, answer } = begin();
  editing.material = 'asphalt';
  editing.use(place(0, 0));
  assert.equal((operation() as { material: string }).material, 'asphalt');
  answer(1);
  editing.undo();
  assert.deepEqual(operation(), { op: 'undo', edit: 1 });
});

test('the radius keeps to what the server takes of each tool, in whole steps', () => {
  const { editing } = begin();
  for (const [tool, most] of [['crater', 256], ['smooth', 64], ['road', 32]] as const) {
    editing.choose(tool);
    editing.widen(1000);
    assert.equal(editing.radius, most);
    editing.widen(-1000);
    assert.equal(editing.radius, 0.5);
    for (let k = 0; k < 50; ++k) {
      const before = editing.radius;
      editing.widen(1);
      assert.ok(editing.radius > before || before === most);
      assert.equal((editing.radius * 256) % 1, 0);
    }
  }
  editing.choose('crater');
  editing.widen(1000);
  editing.choose('smooth');
  assert.equal(editing.radius, 64, 'another tool brings it within its own');
});

test('a road has the corners that were clicked, and no double click twice', () => {
  const { editing, sent, said, operation } = begin();
  editing.choose('road');
  editing.use(place(0, 0));
  editing.endRoad();
  assert.equal(sent.length, 0);
  assert.match(said[0]!, /at least two corners/);
  editing.use(place(100, 0));
  editing.use(place(900, 0));
  editing.undo(); // the last corner
  editing.use(place(100, 60));
  editing.use(place(100.1, 60));
  editing.endRoad();
  assert.deepEqual(operation(), { op: 'road', line: [[0, 0], [100, 0], [100, 60]], width: 16 });
  assert.equal(editing.line.length, 0);
  editing.use(place(0, 0));
  editing.choose('crater');
  editing.endRoad();
  assert.equal(sent.length, 1, 'another tool leaves the road');
});

test('says what the server answers', () => {
  const { editing, said, answer } = begin();
  editing.use(place(0, 0));
  answer(17);
  editing.use(place(0, 0));
  answer(0, 'Too large.');
  answer(0, 'Too large.'); // an answer that comes twice counts once
  assert.deepEqual(said, ['Edit 17 made.', 'Too large.']);
});

test('an undo is of one\'s own last edit that counts', () => {
  const { editing, sent, said, operation, answer } = begin();
  const undoes = (): number => (operation() as { edit: number }).edit;
  for (const number of [3, 5, 9]) {
    editing.use(place(0, 0));
    answer(number);
  }
  editing.undo();
  assert.equal(undoes(), 9);
  answer(10);
  assert.equal(said.at(-1), 'Edit 9 undone.');
  // Somebody else has undone 5: then 3 is the last.
  editing.undo();
  assert.equal(undoes(), 5);
  editing.choose('road'); // a road that was begun meanwhile keeps its corner
  editing.use(place(0, 0));
  answer(0, 'Edit 5 is undone already; undo the edit that undid it to have it back.');
  assert.equal(undoes(), 3);
  assert.equal(editing.line.length, 1);
  editing.rest();
  // A server that has no time now leaves it to be undone.
  answer(0, 'The edits of this client look at too many posts; try again.');
  assert.match(said.at(-1)!, /too many posts/);
  assert.ok(editing.mayUndo);
  editing.undo();
  assert.equal(undoes(), 3);
  answer(12);
  const count = sent.length;
  editing.undo();
  assert.equal(sent.length, count);
  assert.equal(said.at(-1), 'You have no edit to undo.');
});

test('what is not answered goes again over the next connection, with its key, a few times', () => {
  const { editing, sent, said, answer } = begin();
  editing.use(place(0, 0));
  editing.connected('default');
  assert.deepEqual(sent[1], sent[0]);
  answer(4);
  editing.connected('default');
  assert.equal(sent.length, 2, 'what is answered does not');
  editing.use(place(0, 0));
  assert.notEqual(sent[2]!.key, sent[0]!.key);
  for (let k = 0; k < 9; ++k) editing.connected('default');
  assert.equal(sent.length, 5);
  assert.match(said.at(-1)!, /check whether it was made/);
  // Nothing of one session goes to another.
  editing.use(place(0, 0));
  editing.connected('elsewhere');
  assert.equal(sent.length, 6);
  assert.ok(!editing.mayUndo);
});

test('a server that does not answer is not flooded', () => {
  const { editing, sent, said, answer } = begin();
  editing.use(place(0, 0));
  answer(1);
  for (let k = 0; k < 100; ++k) editing.use(place(k, 0));
  assert.equal(sent.length, 17);
  assert.match(said.at(-1)!, /not answered 16 edits/);
  editing.undo();
  assert.ok(editing.mayUndo, 'an undo that is not sent is left to be made');
});

// ---- the ground ----

test('what lies behind the camera is cut off a line, and a line behind it alone is none', () => {
  const pose: Pose = { x: 0, z: 0, remainderX: 0, remainderZ: 0, y: 0, yaw: 0, pitch: 0 }, frame = { pose, width: 100, height: 100, verticalFov: Math.PI / 2 };
  const ahead = place(1, -4, 1), behind = place(1, 4, 1);
  assert.equal(pathOf([ahead, behind].map((p) => ({ ...p, z: 1024 })), frame, true), '');
  assert.equal(pathOf([ahead, place(2, -4, 2)], frame, false), 'M62.5 37.5L75.0 25.0');
  assert.equal(pathOf([ahead, behind], frame, false), 'M62.5 37.5L550.0 -450.0'); // to 0.1 m before it
  assert.equal(pathOf([behind, ahead, behind], frame, false), 'M550.0 -450.0L62.5 37.5L550.0 -450.0');
});
