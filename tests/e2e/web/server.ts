// The real server as a process on a free loopback port.

import { ChildProcess, spawn } from 'node:child_process';
import { existsSync, mkdtempSync, readFileSync, rmSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join } from 'node:path';

export const sleep = (ms: number, idly = false): Promise<void> =>
  new Promise((done) => {
    const timer = setTimeout(done, ms);
    if (idly) timer.unref(); // nobody stays for this alone
  });

export function needed(name: string): string {
  const value = process.env[name];
  if (!value) throw new Error(`${name} must be set: run this through ctest`);
  return value;
}

/** Without what would be a server's settings. */
export const environment = (): NodeJS.ProcessEnv => Object.fromEntries(Object.entries(process.env).filter(([name]) => !name.startsWith('RIDGECAST_')));

export class Server {
  private constructor(
    private readonly child: ChildProcess,
    private readonly folder: string,
    readonly port: number,
  ) {}

  /** Port 0: any free one. `command`: what comes before the settings, such as replay DIR. */
  static async start(args: string[] = [], port = 0, command: string[] = []): Promise<Server> {
    const folder = mkdtempSync(join(tmpdir(), 'ridgecast-web-'));
    const file = join(folder, 'port');
    const child = spawn(needed('RIDGECAST_SERVER'), [...command, '--port', String(port), '--port-file', file, '--quiet', ...args], {
      stdio: ['ignore', 'inherit', 'inherit'],
      env: environment(),
    });
    for (let k = 0; k < 2400 && child.exitCode === null; ++k) {
      if (existsSync(file)) return new Server(child, folder, Number(readFileSync(file, 'utf8')));
      await sleep(50);
    }
    child.kill('SIGKILL');
    throw new Error('the server did not start');
  }

  get ws(): string {
    return `ws://127.0.0.1:${this.port}`;
  }
  get http(): string {
    return `http://127.0.0.1:${this.port}`;
  }
  /** Where it was started with a certificate. */
  get https(): string {
    return `https://127.0.0.1:${this.port}`;
  }

  signal(signal: NodeJS.Signals): void {
    this.child.kill(signal);
  }
  async stop(signal: NodeJS.Signals = 'SIGTERM'): Promise<void> {
    if (this.child.exitCode === null && this.child.signalCode === null) {
      const ended = new Promise((done) => this.child.once('exit', done));
      this.child.kill(signal);
      await Promise.race([ended, sleep(120_000, true)]);
      this.child.kill('SIGKILL');
    }
    rmSync(this.folder, { recursive: true, force: true });
  }
}
