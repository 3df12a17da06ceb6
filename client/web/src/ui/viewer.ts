// What a person does on the page, and what it shows: hands move the camera, the engine and the painter are told, and what they say is
// shown. Nothing here takes long: what does runs in the two workers.

import type { FromEngine, FromPainter, Look, Mode, WorldTold } from '../messages';
import { type Pose, STEPS_PER_METRE } from '../render/view';
import { Clock } from './clock';
import { Divider } from './divider';
import { Editor } from './editor';
import { EngineLink } from './engine_link';
import { Flying, beside } from './flying';
import { Hands } from './hands';
import { byCode, listKeys } from './keys';
import { Place, placeOf, readPlace, writePlace } from './link';
import { Members } from './members';
import { remember, remembered } from './memory';
import { Notices, element } from './notices';
import { PainterLink } from './painter_link';
import { Panel } from './panel';
import { People } from './people';
import { Statistics } from './statistics';
import { Toggle, Toolbar } from './toolbar';
import { Welcome, hasFingers } from './welcome';
import { World, Worlds } from './worlds';

const VERTICAL_FOV = Math.PI / 3;
const MAX_PIXELS = 2.5e6; // of the canvas; more are not worth their time
const UNKNOWN_GROUND = 3000; // metres
const PATIENCE = 2000; // ms, for the height of the ground
const BRIEFLY = 500; // ms: shorter losses are not told of

function pixels(): { width: number; height: number } {
  const ratio = Math.min(devicePixelRatio || 1, Math.sqrt(MAX_PIXELS / Math.max(1, innerWidth * innerHeight)));
  return { width: Math.max(1, Math.round(innerWidth * ratio)), height: Math.max(1, Math.round(innerHeight * ratio)) };
}
const lens = (): { verticalFov: number; width: number; height: number } => ({ verticalFov: VERTICAL_FOV, ...pixels() });
const sentenceOf = (error: unknown): string => (error instanceof Error ? error.message : String(error));

/** Pixels: as the link says, else as it was chosen last; 0: the server's own. */
const thresholdOf = (place: Place): number => place.threshold ?? Number(remembered('threshold'));

export class Viewer {
  readonly flying: Flying;
  readonly engine: EngineLink;
  readonly painter: PainterLink;
  private readonly canvas = element<HTMLCanvasElement>('view');
  private readonly place = readPlace(location);
  private readonly look: Look = { mode: this.place.mode, divider: 0.5, wireframe: false, nodes: false, candidates: false, corrected: remembered('corrected') !== 'no' };
  private readonly hands = new Hands(this.canvas);
  private readonly notices = new Notices();
  private readonly welcome = new Welcome(this.notices);
  private readonly statistics = new Statistics();
  private readonly members = new Members(element('members'));
  private readonly editor: Editor;
  private readonly toolbar: Toolbar;
  private readonly worlds: Worlds;
  readonly clock: Clock;
  private readonly people: People;
  private readonly divider = new Divider((share) => {
    this.look.divider = share;
    this.setLook();
  });
  private token: string;
  private ground: 'known' | 'wanted' | 'of the mesh'; // the height at the start: of the mesh where the server does not say
  private draws = true; // a page that does not is no member of a session
  private losing = 0; // timer: a recording that begins again is back at once
  private makingSince = 0; // when a world was asked for that the server may have to compile; 0: none is waited for
  private readonly frames = { last: performance.now(), savedAt: 0, speed: 0 }; // the last; when the address was brought up to date; the speed shown

  constructor() {
    this.flying = new Flying(this.place.pose);
    this.token = this.place.token || sessionStorage.getItem('token') || '';
    this.ground = Number.isFinite(this.place.pose.y) ? 'known' : 'wanted';
    this.engine = new EngineLink(
      (message) => this.hearEngine(message),
      (sentence) => this.fail('The page failed', `${sentence || 'Its engine could not be loaded.'} Reload it.`),
    );
    this.painter = new PainterLink(
      (message) => this.hearPainter(message),
      (sentence) => this.fail('No pictures', `${sentence || 'The part of the page that draws could not be loaded.'} Reload it.`),
    );
    this.editor = new Editor(this.canvas, this.hands, (message) => this.engine.send(message));
    this.toolbar = new Toolbar({ mode: (mode) => this.setMode(mode), toggle: (name) => this.toggle(name), threshold: (pixelsOfError) => this.setThreshold(pixelsOfError) });
    this.worlds = new Worlds({ goTo: (world) => this.goTo(world), jump: (to) => this.jump(to) });
    this.clock = new Clock((drive, to) => this.engine.send({ kind: 'drive', drive, to }));
    this.people = new People({ fly: (to) => (this.flying.pose = beside(this.flying.pose, to)), renamed: () => this.connect() });
    this.people.take(this.place.name);
    this.listen();
  }

  begin(): void {
    if (!('transferControlToOffscreen' in this.canvas) || typeof OffscreenCanvas === 'undefined')
      return this.fail('This browser is too old', 'The viewer draws in a worker (OffscreenCanvas), which needs Chrome 69, Firefox 105, Safari 17 or newer.');
    const canvas = this.canvas.transferControlToOffscreen(), { port1, port2 } = new MessageChannel();
    this.engine.followBy(port1);
    this.painter.send({ kind: 'begin', canvas, engine: port2 }, [canvas, port2]);
    this.resize();
    this.setLook();
    this.connect(); // the driver may take a second to begin
    requestAnimationFrame((now) => this.frame(now));
    setInterval(() => {
      this.showStatistics();
      this.showWaiting();
    }, 250);
  }

  /** Whether the mesh, or the picture, is all that will come for this pose. */
  get atRest(): boolean {
    return this.engine.isAtRest(this.flying.pose);
  }
  get drawn(): boolean {
    return this.atRest && this.painter.hasDrawn(this.engine.figures!.changes);
  }

  private listen(): void {
    const { hands } = this, help = new Panel('help-text');
    hands.attachTouch(element('stick'), element('lift'), element('pace'));
    const actions: Record<string, () => void> = {
      mesh: () => this.setMode('mesh'),
      march: () => this.setMode('march'),
      split: () => this.setMode('split'),
      corrected: () => this.toggle('corrected'),
      wireframe: () => this.toggle('wireframe'),
      leaves: () => this.toggle('nodes'),
      candidates: () => this.toggle('candidates'),
      figures: () => this.toggle('figures'),
      picture: () => this.painter.send({ kind: 'picture' }),
      gltf: () => void this.keepMesh(),
      link: () => void this.copyLink(),
      help: () => void help.toggle(),
      worlds: () => void this.worlds.toggle(this.engine.world?.session, this.authorization()),
      people: () => this.people.toggle(this.flying.pose),
      edit: () => void this.edit(),
      undo: () => this.editor.undo(),
      road: () => this.editor.endRoad(),
      clock: () => this.clock.show(!this.clock.isShown),
      pause: () => this.clock.toggle(),
      slower: () => this.clock.slower(),
      faster: () => this.clock.faster(),
      rewind: () => this.clock.rewind(),
      skip: () => this.clock.skip(),
    };
    const keys = byCode(actions);
    listKeys(element('help-text').querySelector<HTMLElement>('.keys')!);
    const repeated: Record<string, () => void> = { Comma: () => this.divider.by(-1), Period: () => this.divider.by(1), BracketLeft: () => this.editor.widen(-1), BracketRight: () => this.editor.widen(1) };
    hands.onKey = (code, again) => {
      const act = repeated[code] ?? (again ? undefined : keys[code]);
      act?.();
      return act !== undefined;
    };
    for (const [id, action] of Object.entries({ picture: 'picture', gltf: 'gltf', link: 'link', help: 'help', place: 'worlds', people: 'people', editing: 'edit', timing: 'clock' })) element(id).addEventListener('click', actions[action]!);
    element('again').addEventListener('click', () => this.connect());
    element('token').addEventListener('submit', (event) => {
      event.preventDefault();
      this.token = String(new FormData(event.target as HTMLFormElement).get('token') ?? '').trim();
      sessionStorage.setItem('token', this.token); // of this tab alone, and not in links
      this.connect();
    });
    window.addEventListener('hashchange', () => this.follow());
    window.addEventListener('resize', () => this.resize());
    window.addEventListener('online', () => this.engine.hurry());
    window.addEventListener('pagehide', () => this.engine.close());
    window.addEventListener('pageshow', (event) => {
      if (event.persisted) this.connect();
    });
  }

  // ---- the server ----

  private streamUrl(): string {
    const { session, terrain, seed, parameters, clock } = this.place;
    const url = new URL('./v1/stream', location.href);
    url.protocol = url.protocol === 'https:' ? 'wss:' : 'ws:';
    url.hash = '';
    url.search = '';
    url.searchParams.set('session', session);
    if (!terrain) return url.href;
    url.searchParams.set('terrain', terrain);
    if (seed) url.searchParams.set('seed', seed);
    for (const parameter of parameters) url.searchParams.append('param', parameter);
    if (clock) url.searchParams.set('clock', clock);
    return url.href;
  }

  /** Begins, or begins again; the mesh that is held is kept. */
  private connect(): void {
    if (!this.draws) return;
    this.makingSince = this.place.terrain ? performance.now() : 0;
    this.notices.noProblem();
    this.engine.connect(this.streamUrl(), { threshold: thresholdOf(this.place), token: this.token, name: this.people.ownName });
  }

  /** For good. */
  private fail(title: string, sentence: string): void {
    this.draws = false;
    this.engine.close();
    this.notices.fatal(title, sentence);
  }

  private showWaiting(): void {
    if (this.engine.world) this.welcome.show(this.engine.figures?.decoded ?? 0, this.painter.frames !== undefined);
    const seconds = Math.floor((performance.now() - this.makingSince) / 1000);
    if (this.makingSince > 0 && seconds >= 2) this.notices.light('wait', `waiting for the server to prepare the terrain, ${seconds} s`);
  }

  private hearEngine(message: FromEngine): void {
    switch (message.kind) {
      case 'world':
        return this.enter(message.world);
      case 'lost':
        return this.showLost(message);
      case 'silence':
        return this.showConnected(message.isSilent);
      case 'ground':
        if (this.ground === 'of the mesh') this.beginAbove(message.metres);
        return;
      case 'members':
        this.people.set(message.members, message.others);
        return this.members.set(message.members);
      case 'granted':
        return this.toolbar.showThreshold(message.threshold);
      case 'editing':
        return this.editor.hear(message.editing);
      case 'touched':
        return this.editor.touch(message.touched);
      case 'clock':
        return this.clock.set(message.clock);
      case 'notice':
        return this.notices.note(message.sentence, 8000);
    }
  }

  private enter(world: WorldTold): void {
    const { terrain, lacks, threshold, map } = world;
    this.clock.enter(world);
    this.makingSince = 0;
    clearTimeout(this.losing);
    this.notices.noProblem();
    this.notices.note('', 0);
    this.showConnected(false);
    document.title = `${terrain} · Ridgecast`;
    if (lacks && this.look.mode !== 'mesh') this.setMode('mesh');
    this.toolbar.allowTerrain(!lacks);
    this.toolbar.showThreshold(threshold);
    if (map && this.place.isAnywhere) this.goOnto(map);
    this.place.isAnywhere = false;
    void this.askGround();
  }

  private showConnected(isSilent: boolean): void {
    const { terrain, seed, session } = this.engine.world!;
    if (isSilent) this.notices.light('wait', 'the server is silent');
    else this.notices.light('on', `${terrain}, seed ${seed}${session === 'default' ? '' : ` · ${session}`}`);
  }

  private async edit(): Promise<void> {
    if (this.editor.on) return this.editor.end();
    const why = await this.editor.begin(this.engine.lost ? undefined : this.engine.world, this.authorization());
    if (why) this.notices.note(why, 8000);
  }

  private showLost({ sentence, final, wantsToken }: Extract<FromEngine, { kind: 'lost' }>): void {
    const { notices } = this;
    this.makingSince = 0;
    clearTimeout(this.losing);
    notices.light(final ? 'off' : 'wait', final ? 'not connected' : 'reconnecting');
    if (wantsToken) notices.problem('This server asks for a token', this.token ? `${sentence} Give another one.` : 'Ask whoever runs it for one.', 'token');
    else if (final) notices.problem('Not connected', sentence, 'again');
    else if (this.engine.figures) this.losing = window.setTimeout(() => notices.note(`${sentence} The picture shows what had arrived; trying again.`, 0), BRIEFLY);
    else notices.problem('No connection to the server', `${sentence} Trying again.`, 'again');
  }

  private authorization(): Record<string, string> {
    return this.token ? { Authorization: `Bearer ${this.token}` } : {};
  }

  // ---- pictures and files ----

  private hearPainter(message: FromPainter): void {
    switch (message.kind) {
      case 'problem':
        return message.fatal ? this.fail('No pictures', message.sentence) : this.notices.note(message.sentence, 12_000);
      case 'picture':
        this.keep(message.png, 'png');
        return this.notices.note('The picture is saved in your downloads.');
    }
  }

  private keep(file: Blob, extension: string): void {
    const link = document.createElement('a');
    link.href = URL.createObjectURL(file);
    link.download = `ridgecast-${this.engine.world?.terrain ?? 'view'}.${extension}`;
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
  }

  /** Exactly the mesh that this page holds, from the server. */
  private async keepMesh(): Promise<void> {
    const { world } = this.engine, { notices } = this;
    if (!world) return;
    notices.note('The server writes the mesh …', 0);
    try {
      const answer = await fetch(`./v1/sessions/${world.session}/snapshot.glb?camera=${world.camera}`, { headers: this.authorization() });
      if (!answer.ok) throw new Error((await answer.text()).trim().slice(0, 300));
      this.keep(await answer.blob(), 'glb');
      notices.note('The mesh is saved in your downloads.');
    } catch (error) {
      notices.note(`The server gives no mesh: ${sentenceOf(error)}`, 8000);
    }
  }

  // ---- what is drawn ----

  private resize(): void {
    this.painter.send({ kind: 'size', ...pixels() });
    this.engine.lookAgain();
  }

  private setLook(): void {
    this.painter.send({ kind: 'look', look: { ...this.look } });
    this.toolbar.show(this.look, this.statistics.wanted);
    this.divider.show(this.look.mode === 'split', this.look.divider);
    this.showStatistics();
  }

  private setMode(mode: Mode): void {
    const lacks = this.engine.world?.lacks;
    if (mode !== 'mesh' && lacks) return this.notices.note(`${lacks}: there is no ray march.`);
    this.look.mode = mode;
    this.setLook();
  }

  private toggle(name: Toggle): void {
    if (name === 'corrected') return this.toggleCorrected();
    if (name === 'figures') this.statistics.wanted = !this.statistics.wanted;
    else this.look[name] = !this.look[name];
    if (name === 'wireframe' && this.look.wireframe && (this.engine.world?.threshold ?? 0) <= 1) this.notices.note('Triangles are about as small as pixels at this error; at 4 px they are seen.', 6000);
    if (name === 'candidates') this.engine.send({ kind: 'candidates', wanted: this.look.candidates });
    this.setLook();
  }

  private toggleCorrected(): void {
    const { look, notices } = this, lacks = this.engine.world?.lacks;
    if (lacks) return notices.note(`${lacks}: the mesh is drawn as it is.`);
    look.corrected = !look.corrected;
    remember('corrected', look.corrected ? 'yes' : 'no');
    notices.note(look.corrected ? 'The mesh, corrected onto the true surface.' : 'The mesh as it is.');
    this.setLook();
  }

  private setThreshold(threshold: number): void {
    this.place.threshold = threshold;
    remember('threshold', String(threshold));
    this.engine.send({ kind: 'threshold', pixels: threshold });
  }

  private showStatistics(): void {
    const { look, flying, engine, painter } = this;
    this.statistics.show({ look, flying, ground: engine.ground, figures: engine.figures, frames: painter.frames, atRest: this.atRest, others: engine.countOfOthers });
  }

  // ---- places ----

  private address(): string {
    return location.origin + location.pathname + writePlace({ ...this.place, pose: this.flying.pose, mode: this.look.mode });
  }

  private async copyLink(): Promise<void> {
    history.replaceState(null, '', this.address());
    try {
      await navigator.clipboard.writeText(this.address());
      this.notices.note('The link to this place is copied.');
    } catch {
      this.notices.note('The link to this place is in the address bar.');
    }
  }

  /** Goes where the page's address says. */
  private follow(): void {
    this.goThere(readPlace(location));
  }
  private goThere(next: Place): void {
    const { place } = this;
    const elsewhere = next.session !== place.session || next.terrain !== place.terrain, finer = next.threshold !== place.threshold;
    Object.assign(place, next, { isAnywhere: next.isAnywhere && elsewhere });
    this.people.take(next.name);
    this.flying.pose = next.pose;
    if (next.token) this.token = next.token;
    this.look.mode = next.mode;
    this.setLook();
    if (!Number.isFinite(next.pose.y)) this.ground = 'wanted';
    if (elsewhere) return this.connect();
    void this.askGround();
    if (finer) this.engine.send({ kind: 'threshold', pixels: thresholdOf(next) });
  }

  /** Where somebody types to go; false: that is no place. A place without a world is in this one. */
  private jump(to: string): boolean {
    const where = placeOf(to);
    if (!where) return false;
    const { session, terrain, seed, parameters, clock, threshold } = this.place;
    const next = readPlace(where), here = 'href' in where ? {} : { session, terrain, seed, parameters, clock, threshold, mode: this.look.mode };
    this.goThere({ ...next, ...here });
    return true;
  }

  private goTo(world: World): void {
    Object.assign(this.place, world);
    history.replaceState(null, '', this.address());
    this.notices.light('wait', 'connecting');
    this.connect();
  }

  /** A map may lie far from x 0, z 0 (place=geo). */
  private goOnto({ x0, z0, x1, z1 }: NonNullable<WorldTold['map']>): void {
    const { pose } = this.flying;
    if (pose.x >= x0 && pose.x < x1 && pose.z >= z0 && pose.z < z1) return;
    this.flying.pose = { ...pose, x: Math.floor((x0 + x1) / 2), z: Math.floor((z0 + z1) / 2) };
    this.ground = 'wanted';
  }

  private async groundAt({ x, z }: Pose): Promise<number | undefined> {
    const session = encodeURIComponent(this.engine.world?.session ?? this.place.session), at = `${x / STEPS_PER_METRE},${z / STEPS_PER_METRE}`;
    try {
      const answer = await fetch(`./v1/heights?session=${session}&at=${at}`, { headers: this.authorization(), signal: AbortSignal.timeout(PATIENCE) });
      return answer.ok ? ((await answer.json()) as { heights: number[] }).heights[0] : undefined;
    } catch {
      return undefined;
    }
  }
  /** Of the server. Where it does not say, the page looks from far above until the mesh says where the ground is. */
  private async askGround(): Promise<void> {
    if (this.ground !== 'wanted') return;
    const { pose } = this.flying, metres = await this.groundAt(pose);
    if (pose !== this.flying.pose) return;
    if (metres !== undefined) return this.beginAbove(metres);
    this.ground = 'of the mesh';
    this.flying.pose = { ...pose, y: UNKNOWN_GROUND };
  }
  /** The start is given above the ground, whose height was not known until now. */
  private beginAbove(metres: number): void {
    if (this.ground === 'known') return;
    this.ground = 'known';
    this.flying.pose = { ...this.flying.pose, y: metres + this.place.altitude };
    this.engine.show(this.flying.pose, lens(), performance.now()); // frames may be rare while the driver begins
  }

  // ---- frames ----

  private frame(now: number): void {
    requestAnimationFrame((next) => this.frame(next));
    const seconds = Math.min(0.1, Math.max(0, (now - this.frames.last) / 1000));
    this.frames.last = now;
    const input = this.hands.take(seconds);
    if (this.ground === 'wanted') return;
    this.flying.step(input, seconds, this.engine.ground);
    this.showSpeed();
    const { pose } = this.flying;
    this.painter.look(pose, VERTICAL_FOV);
    this.engine.show(pose, lens(), now);
    this.saveAddress(pose, now);
    this.members.draw({ pose, ...lens() }, innerWidth, innerHeight);
    this.people.draw(pose);
    this.clock.draw();
    this.editor.draw({ pose, verticalFov: VERTICAL_FOV, width: innerWidth, height: innerHeight }, this.engine.figures?.changes ?? 0);
  }

  private showSpeed(): void {
    const { speed } = this.flying;
    if (speed === this.frames.speed) return;
    if (this.frames.speed > 0 && !hasFingers()) this.notices.note(`Speed ${Math.round(speed)} m/s`);
    this.frames.speed = speed;
    element('speed').textContent = `${Math.round(speed)} m/s`;
  }

  /** Every two seconds, where the camera stands. */
  private saveAddress(pose: Pose, now: number): void {
    if (now - this.frames.savedAt <= 2000 || !this.engine.knows(pose)) return;
    this.frames.savedAt = now;
    const next = this.address();
    if (next !== location.href && this.engine.world) history.replaceState(null, '', next);
  }
}
