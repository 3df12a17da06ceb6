// Lines over the picture.

import assert from 'node:assert/strict';
import { test } from 'node:test';
import type { Place } from '../../../../client/web/src/messages';
import type { Pose } from '../../../../client/web/src/render/view';
import { pathOf } from '../../../../client/web/src/ui/outline';

const place = (x: number, z: number, y = 0): Place => ({ x: 256 * x, z: 256 * z, y });

test('what lies behind the camera is cut off a line, and a line behind it alone is none', () => {
  const pose: Pose = { x: 0, z: 0, remainderX: 0, remainderZ: 0, y: 0, yaw: 0, pitch: 0 }, frame = { pose, width: 100, height: 100, verticalFov: Math.PI / 2 };
  const ahead = place(1, -4, 1), behind = place(1, 4, 1);
  assert.equal(pathOf([ahead, behind].map((p) => ({ ...p, z: 1024 })), frame, true), '');
  assert.equal(pathOf([ahead, place(2, -4, 2)], frame, false), 'M62.5 37.5L75.0 25.0');
  assert.equal(pathOf([ahead, behind], frame, false), 'M62.5 37.5L550.0 -450.0'); // to 0.1 m before it
  assert.equal(pathOf([behind, ahead, behind], frame, false), 'M550.0 -450.0L62.5 37.5L550.0 -450.0');
});
