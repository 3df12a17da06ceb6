// What somebody is told who opens the page: how much has come until there is a picture, then, on the first visit, how to fly.

import { remember, remembered } from './memory';
import type { Notices } from './notices';

export const hasFingers = (): boolean => matchMedia('(pointer: coarse)').matches;

export class Welcome {
  private over = false;

  constructor(private readonly notices: Notices) {}

  show(triangles: number, hasPicture: boolean): void {
    if (this.over) return;
    if (!hasPicture) return this.notices.aside(triangles === 0 ? 'The mesh is on its way' : `${triangles.toLocaleString('en')} triangles received`, 0);
    this.over = true;
    if (remembered('welcomed')) return this.notices.aside('', 0);
    remember('welcomed', 'yes');
    this.notices.aside(hasFingers() ? 'Drag to look around; the stick flies.' : 'Drag to look around, W A S D to fly. H lists all keys.', 10_000);
  }
}
