// Debian's Chromium without a screen, drawing in software, and what the page tells about itself.

import { createRequire } from 'node:module';
import { existsSync } from 'node:fs';
import type { Browser, BrowserContextOptions, CDPSession, Page } from 'playwright-core';
import type { Report } from '../../../client/web/src/main';
import { needed, sleep } from './server';

const PROGRAM = process.env['CHROMIUM'] ?? '/usr/bin/chromium';
const SWITCHES = ['--headless=new', '--no-sandbox', '--disable-quic', '--no-first-run', '--disable-background-networking', '--disable-component-update', '--disable-sync', '--disable-backgrounding-occluded-windows', '--disable-renderer-backgrounding'];
const SOFTWARE = ['--use-gl=angle', '--use-angle=swiftshader', '--enable-unsafe-swiftshader'];

/** Why no page can be tested here; empty: one can. */
export function missing(): string {
  if (!existsSync(PROGRAM)) return `there is no browser at ${PROGRAM}; Debian's package is chromium`;
  if (!existsSync(`${needed('RIDGECAST_PAGE')}/index.html`)) return 'the page is not built; ./run build does that';
  return '';
}

// Only there to end what hangs: a machine with much else to do may take long for anything.
export const PATIENCE = 180_000;

const launched: Browser[] = [];

export async function closeAll(): Promise<void> {
  for (const browser of launched) await browser.close();
}

export async function launch(switches: string[] = SOFTWARE): Promise<Browser> {
  const { chromium } = createRequire(needed('RIDGECAST_WEB') + '/')('playwright-core') as typeof import('playwright-core');
  const browser = await chromium.launch({ executablePath: PROGRAM, args: [...SWITCHES, ...switches], timeout: PATIENCE });
  launched.push(browser);
  return browser;
}

interface Watched {
  ridgecast?: Report;
  longTasks: { start: number; ms: number }[];
  notes: string[]; // that nobody waited for yet
}

export class Viewer {
  readonly complaints: string[] = [];
  private devices: CDPSession | undefined;
  private constructor(readonly page: Page) {}

  static async open(browser: Browser, url: string, size = { width: 640, height: 360 }, more: BrowserContextOptions = {}): Promise<Viewer> {
    const context = await browser.newContext({ viewport: size, acceptDownloads: true, ...more });
    context.setDefaultTimeout(PATIENCE);
    const page = await context.newPage();
    const viewer = new Viewer(page);
    page.on('console', (message) => {
      if (message.type() === 'error' || message.type() === 'warning') viewer.complaints.push(message.text());
    });
    page.on('pageerror', (error) => viewer.complaints.push(error.message));
    await page.addInitScript(() => {
      const own = globalThis as unknown as Watched;
      own.longTasks = [];
      new PerformanceObserver((list) => {
        for (const entry of list.getEntries()) own.longTasks.push({ start: entry.startTime, ms: entry.duration });
      }).observe({ type: 'longtask', buffered: true });
      own.notes = [];
      document.addEventListener('DOMContentLoaded', () => {
        const note = document.getElementById('note');
        if (note) new MutationObserver(() => own.notes.push(note.textContent ?? '')).observe(note, { childList: true, characterData: true, subtree: true });
      });
    });
    await page.goto(url);
    return viewer;
  }

  async report(): Promise<Report> {
    return this.page.evaluate(() => ({ ...(globalThis as unknown as Watched).ridgecast! }));
  }

  /** Waits until the page's report says so. */
  async until(what: string, is: (report: Report) => boolean, patience = PATIENCE): Promise<Report> {
    const end = Date.now() + patience;
    for (;;) {
      const report = await this.report();
      if (report && is(report)) return report;
      if (Date.now() > end) throw new Error(`the page was to be ${what}, but is ${JSON.stringify(report)}, ${await this.problem()}`);
      await sleep(100);
    }
  }

  /** Waits until the camera stands: the same pose over ten of the page's frames. */
  async still(): Promise<Report> {
    for (const end = Date.now() + PATIENCE; Date.now() < end; ) {
      const before = await this.report();
      await this.page.evaluate(
        () =>
          new Promise<void>((done) => {
            let left = 10;
            const next = (): unknown => (left-- > 0 ? requestAnimationFrame(next) : done());
            next();
          }),
      );
      const now = await this.report();
      if (JSON.stringify(now.pose) === JSON.stringify(before.pose)) return now;
    }
    throw new Error('the camera does not come to a stand');
  }

  /** The picture that the page keeps for people. */
  async picture(): Promise<Buffer> {
    const [download] = await Promise.all([this.page.waitForEvent('download'), this.page.keyboard.press('KeyP')]);
    const chunks: Buffer[] = [];
    for await (const chunk of await download.createReadStream()) chunks.push(chunk as Buffer);
    return Buffer.concat(chunks);
  }

  /** What the page says in its middle; empty when it says nothing. */
  async problem(): Promise<string> {
    return this.page.evaluate(() => {
      const box = document.getElementById('problem')!;
      return box.hidden ? '' : box.innerText.replace(/\s+/g, ' ').trim();
    });
  }

  /** Waits until the page has said so in a note since the one that was waited for last: notes go by themselves, on a busy machine before anybody looks. */
  async said(what: RegExp): Promise<void> {
    await this.page.waitForFunction((source) => {
      const { notes } = globalThis as unknown as Watched, k = notes.findIndex((note) => new RegExp(source).test(note));
      return k >= 0 && notes.splice(0, k + 1);
    }, what.source);
  }

  /** Milliseconds of the longest task of the page's own thread since it had run so long. */
  async longestTask(since: number): Promise<number> {
    return this.page.evaluate((from) => Math.max(0, ...(globalThis as unknown as Watched).longTasks.filter((t) => t.start >= from).map((t) => t.ms)), since);
  }
  /** Seconds that the page's own thread has worked, by its own clock, which stands while others have the processor. */
  async worked(): Promise<number> {
    this.devices ??= await this.page.context().newCDPSession(this.page);
    await this.devices.send('Performance.enable', { timeDomain: 'threadTicks' });
    const { metrics } = await this.devices.send('Performance.getMetrics');
    return metrics.find((m) => m.name === 'TaskDuration')!.value;
  }
  async now(): Promise<number> {
    return this.page.evaluate(() => performance.now());
  }
  async close(): Promise<void> {
    await this.page.context().close();
  }
}
