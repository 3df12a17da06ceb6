// The buttons of the page's bar: what is drawn, what lies over it, and how fine the mesh is.

import type { Look, Mode } from '../messages';
import { element } from './notices';

export type Toggle = 'corrected' | 'wireframe' | 'nodes' | 'candidates' | 'figures';

export class Toolbar {
  private readonly modes = document.querySelectorAll<HTMLButtonElement>('[data-mode]');
  private readonly toggles = document.querySelectorAll<HTMLButtonElement>('[data-toggle]');
  private readonly threshold = element<HTMLSelectElement>('threshold');

  constructor(on: { mode: (mode: Mode) => void; toggle: (name: Toggle) => void; threshold: (pixels: number) => void }) {
    for (const button of this.modes) button.addEventListener('click', () => on.mode(button.dataset['mode'] as Mode));
    for (const button of this.toggles) button.addEventListener('click', () => on.toggle(button.dataset['toggle'] as Toggle));
    // On a narrow screen the tools open below the bar.
    const bar = element('bar'), more = element('more');
    const open = (is: boolean): void => {
      bar.classList.toggle('open', is);
      more.setAttribute('aria-expanded', String(is));
    };
    more.addEventListener('click', () => open(!bar.classList.contains('open')));
    element('view').addEventListener('pointerdown', () => open(false));
    // Who clicks goes on flying: Space then rises, and does not press the button again. Keys keep the focus where it is.
    bar.addEventListener('click', (event) => {
      if (event.detail > 0 && (event.target as HTMLElement).closest('[data-mode], [data-toggle]')) element('view').focus({ preventScroll: true });
    });
    this.threshold.addEventListener('change', () => on.threshold(Number(this.threshold.value)));
  }

  show(look: Look, figures: boolean): void {
    const on: Record<Toggle, boolean> = { ...look, figures };
    for (const button of this.modes) button.setAttribute('aria-pressed', String(button.dataset['mode'] === look.mode));
    for (const button of this.toggles) button.setAttribute('aria-pressed', String(on[button.dataset['toggle'] as Toggle]));
  }

  /** What needs the terrain's own functions. */
  allowTerrain(allowed: boolean): void {
    for (const button of this.modes) button.disabled = !allowed && button.dataset['mode'] !== 'mesh';
    for (const button of this.toggles) button.disabled = !allowed && button.dataset['toggle'] === 'corrected';
  }

  showThreshold(granted: number): void {
    let option = [...this.threshold.options].find((o) => Number(o.value) === granted);
    if (!option) {
      option = new Option(`${Number(granted.toPrecision(3))} px`, String(granted));
      this.threshold.add(option);
    }
    option.selected = true;
  }
}
