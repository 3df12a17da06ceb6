// How far the programs of a world are. Its mesh is drawn at once, in neutral colours that need no terrain; the terrain's own follow when a
// picture is shown, then the correction of the mesh and the ray march when somebody wants them: one after the other.

import type { WebGLRenderer } from 'three';
import { Programs } from './programs';
import type { ViewUniforms } from './view';

type State = 'unasked' | 'compiling' | 'ready' | 'refused';

export class WorldPrograms {
  private readonly own: Programs | undefined;
  private colours: State = 'unasked';
  private march: State = 'unasked';
  private correction: State = 'unasked';

  /** An empty source is a world whose text is private. `changed` is called when more can be drawn, `complain` when the driver refuses. */
  constructor(
    source: string,
    view: ViewUniforms,
    private readonly neutral: Programs,
    private readonly renderer: WebGLRenderer,
    private readonly on: { changed: () => void; complain: (sentence: string) => void },
  ) {
    if (source) this.own = new Programs(source, view);
  }

  /** What pictures are drawn with now. */
  get current(): Programs {
    return this.own && this.colours === 'ready' ? this.own : this.neutral;
  }
  /** With the terrain's height, compiled; nothing where there is none. */
  async heights(): Promise<Programs | undefined> {
    return this.own && !(await this.own.compile(['heights'], this.renderer)) ? this.own : undefined;
  }
  get coloursAreFinal(): boolean {
    return !this.own || this.colours === 'ready' || this.colours === 'refused';
  }
  get mayMarch(): boolean {
    return this.own !== undefined && this.colours !== 'refused' && this.march !== 'refused';
  }
  get canMarch(): boolean {
    return this.march === 'ready';
  }
  get mayCorrect(): boolean {
    return this.own !== undefined && this.colours !== 'refused' && this.correction !== 'refused';
  }
  get canCorrect(): boolean {
    return this.correction === 'ready';
  }

  async wantColours(): Promise<void> {
    if (!this.own || this.colours !== 'unasked') return;
    this.colours = 'compiling';
    const complaint = await this.own.compile(['shade'], this.renderer);
    this.colours = complaint ? 'refused' : 'ready';
    if (complaint) this.on.complain(`This graphics driver does not compile the terrain's text (${complaint}); it is drawn in neutral colours, without a ray march.`);
    this.on.changed();
  }
  async wantMarch(): Promise<void> {
    if (!this.own || this.colours !== 'ready' || this.march !== 'unasked' || this.correction === 'compiling') return;
    this.march = 'compiling';
    const complaint = await this.own.compile(['heights', 'skyline', 'march'], this.renderer);
    this.march = complaint ? 'refused' : 'ready';
    if (complaint) this.on.complain(`This graphics driver does not compile the ray march (${complaint}).`);
    this.on.changed();
  }

  async wantCorrection(): Promise<void> {
    if (!this.own || this.colours !== 'ready' || this.correction !== 'unasked' || this.march === 'compiling') return;
    this.correction = 'compiling';
    const complaint = await this.own.compile(['correct'], this.renderer);
    this.correction = complaint ? 'refused' : 'ready';
    if (complaint) this.on.complain(`This graphics driver does not compile the correction (${complaint}); the mesh is drawn as it is.`);
    this.on.changed();
  }

  dispose(): void {
    this.own?.dispose();
  }
}
