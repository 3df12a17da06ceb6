// Statistics for people, and which colour of a candidate is which error.

import type { Figures, Look } from '../messages';
import { ERROR_RANGE, errorColour } from '../render/error_colour';
import type { Frames } from './painter_link';
import type { Flying } from './flying';
import { element } from './notices';

const count = (v: number): string => (v >= 1e6 ? `${(v / 1e6).toFixed(2)} M` : v >= 1e4 ? `${(v / 1e3).toFixed(0)} k` : String(Math.round(v)));

export interface Shown {
  look: Look;
  flying: Flying;
  ground: number | undefined; // metres, below the camera
  figures: Figures | undefined;
  frames: Frames | undefined;
  atRest: boolean;
  others: number;
}

export class Statistics {
  wanted = false;

  show(shown: Shown): void {
    this.showLegend(shown);
    const box = element('figures');
    box.hidden = !this.wanted;
    if (this.wanted) box.textContent = this.lines(shown).join('\n');
  }

  private lines({ flying, ground, figures, frames, atRest, others }: Shown): string[] {
    const { pose } = flying;
    const lines = [
      `x ${(pose.x / 256).toFixed(1)}  z ${(pose.z / 256).toFixed(1)}  y ${pose.y.toFixed(1)} m${ground === undefined ? '' : `, ${(pose.y - ground).toFixed(0)} m above ground`}`,
      `speed ${flying.speed.toFixed(0)} m/s`,
    ];
    if (figures)
      lines.push(
        `iteration ${figures.iteration}${atRest ? ', settled' : ''}  hash ${figures.hashOk ? 'agrees' : 'differs'}`,
        `${count(figures.triangles)} triangles in ${figures.leaves} leaves, error ${figures.effectiveThreshold.toPrecision(3)} px`,
        `${(figures.bytes / 1e6).toFixed(2)} MB received  decoded in ${figures.decodeMs.toFixed(1)} ms  latency ${figures.latencyMs.toFixed(0)} ms`,
      );
    if (frames) lines.push(`${frames.perSecond.toFixed(0)} pictures/s  ${frames.milliseconds.toFixed(0)} ms  ${frames.finest ? 'finest' : `1 sample for ${frames.coarseness}x${frames.coarseness} px`}`);
    if (others > 0) lines.push(`${others} other${others > 1 ? 's' : ''} here`);
    return lines;
  }

  private showLegend({ look, figures }: Shown): void {
    const box = element('legend');
    box.hidden = !look.candidates || look.mode === 'march' || !figures;
    if (box.hidden) return;
    const unit = Math.max(figures!.effectiveThreshold, 1e-3), text = `${figures!.candidates} ${unit}`;
    if (box.dataset['of'] === text) return;
    box.dataset['of'] = text;
    box.replaceChildren(`${figures!.candidates} candidates, error in pixels`);
    for (const share of [1 / ERROR_RANGE, 0.5, 1, 2, ERROR_RANGE]) {
      const entry = document.createElement('span'), colour = document.createElement('i');
      colour.style.background = `rgb(${errorColour(share, 1).map((c) => Math.round(255 * c)).join(' ')})`;
      entry.append(colour, Number((share * unit).toPrecision(2)).toString());
      box.append(entry);
    }
  }
}
