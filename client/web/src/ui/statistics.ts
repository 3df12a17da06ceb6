// Statistics for people, and what the colours of leaves and candidates mean.

import type { Figures, Look } from '../messages';
import { COARSEST_LEVEL, ERROR_RANGE, css, errorColour, levelColour } from '../render/colours';
import type { Frames } from './painter_link';
import type { Flying } from './flying';
import { element } from './notices';

const count = (v: number): string => (v >= 1e6 ? `${(v / 1e6).toFixed(2)} M` : v >= 1e4 ? `${(v / 1e3).toFixed(0)} k` : String(Math.round(v)));

const side = (metres: number): string => (metres < 1000 ? `${metres} m` : `${Math.round(metres / 1000)} km`);

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
    if (frames) {
      const fineness = frames.finest ? 'finest picture' : `${frames.perSecond.toFixed(0)} pictures/s, 1 sample for ${frames.coarseness}x${frames.coarseness} px`;
      lines.push(`${fineness}${frames.corrected ? ', corrected' : ''}, drawn in ${frames.milliseconds.toFixed(0)} ms`);
    }
    if (others > 0) lines.push(`${others} other${others > 1 ? 's' : ''} here`);
    return lines;
  }

  private showLegend({ look, figures }: Shown): void {
    const box = element('legend'), entries: [string, string][] = [];
    if (look.mode !== 'march' && look.nodes) entries.push(['', 'side of a leaf']);
    if (look.mode !== 'march' && look.nodes) for (let level = 0; level <= COARSEST_LEVEL; level += 2) entries.push([css(levelColour(level)), side(32 * 2 ** level)]);
    if (look.mode !== 'march' && look.candidates && figures) {
      const unit = Math.max(figures.effectiveThreshold, 1e-3);
      entries.push(['', `${figures.candidates} candidates, error in pixels`]);
      for (const share of [1 / ERROR_RANGE, 0.5, 1, 2, ERROR_RANGE]) entries.push([css(errorColour(share, 1)), Number((share * unit).toPrecision(2)).toString()]);
    }
    box.hidden = entries.length === 0;
    const text = entries.join();
    if (box.dataset['of'] === text) return;
    box.dataset['of'] = text;
    box.replaceChildren(
      ...entries.map(([colour, label]) => {
        const entry = document.createElement('span'), dot = document.createElement('i');
        dot.style.background = colour;
        entry.append(...(colour ? [dot] : []), label);
        return entry;
      }),
    );
  }
}
