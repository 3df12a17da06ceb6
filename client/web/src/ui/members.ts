// The others in this session, as labels over the picture.

import type { MemberTold } from '../messages';
import { memberColour } from '../render/colours';
import { View, forwardOf, rightOf, tangentsOf, upOf } from '../render/view';
import { distanceText } from './people';

const MOST = 64; // labels; the nearest are shown

export class Members {
  private members: MemberTold[] = [];
  private readonly labels = new Map<string, HTMLElement>();

  constructor(private readonly parent: HTMLElement) {}

  set(members: MemberTold[]): void {
    this.members = members;
    const named = new Set(members.map((m) => m.camera));
    for (const [camera, label] of this.labels)
      if (!named.has(camera)) {
        label.remove();
        this.labels.delete(camera);
      }
  }

  /** Puts the labels where the members are in a window of so many CSS pixels. */
  draw(view: Omit<View, 'horizon'>, width: number, height: number): void {
    const f = forwardOf(view.pose), r = rightOf(view.pose), u = upOf(view.pose);
    const [tx, ty] = tangentsOf(view);
    const near = this.members
      .filter((m) => m.at !== undefined)
      .map((m) => {
        const d = [(m.at!.x - view.pose.x) / 256, m.at!.y - view.pose.y, (m.at!.z - view.pose.z) / 256] as const;
        const dot = (v: readonly number[]): number => v[0]! * d[0] + v[1]! * d[1] + v[2]! * d[2];
        return { m, depth: dot(f), x: dot(r), y: dot(u), distance: Math.hypot(...d) };
      })
      .sort((a, b) => a.distance - b.distance)
      .slice(0, MOST);
    const shown = new Set<string>();
    for (const { m, depth, x, y, distance } of near) {
      if (depth < 0.1 || Math.abs(x / depth) > tx * 1.05 || Math.abs(y / depth) > ty * 1.05) continue;
      shown.add(m.camera);
      let label = this.labels.get(m.camera);
      if (!label) {
        label = document.createElement('div');
        label.className = 'member';
        label.style.setProperty('--own', memberColour(m.camera));
        this.parent.append(label);
        this.labels.set(m.camera, label);
      }
      const text = `${m.name} · ${distanceText(distance)}`;
      if (label.textContent !== text) label.textContent = text;
      label.hidden = false;
      const px = ((x / depth / tx + 1) / 2) * width, py = ((1 - y / depth / ty) / 2) * height;
      label.style.transform = `translate(${px.toFixed(1)}px, ${py.toFixed(1)}px) translate(-50%, calc(-100% - 8px))`;
    }
    for (const [camera, label] of this.labels) if (!shown.has(camera)) label.hidden = true;
  }
}
