// The example pages as `npm run dev` serves them.

import { type ChildProcess, spawn } from 'node:child_process';
import { existsSync } from 'node:fs';
import { createServer } from 'node:net';
import { join } from 'node:path';
import { PATIENCE } from './browser';
import { needed, sleep } from './server';

const HERE = join(needed('RIDGECAST_SOURCE'), 'client/web/examples');
const VITE = join(HERE, 'node_modules/vite/bin/vite.js');

/** Why they cannot be served; empty: they can. */
export const missingExamples = (): string => (existsSync(VITE) ? '' : 'the packages of client/web/examples are not installed; npm ci does that there');

async function freePort(): Promise<number> {
  return new Promise((done) => {
    const socket = createServer().listen(0, '127.0.0.1', () => {
      const { port } = socket.address() as { port: number };
      socket.close(() => done(port));
    });
  });
}

export async function serveExamples(server: { http: string }): Promise<{ url: string; child: ChildProcess }> {
  const port = await freePort(), url = `http://127.0.0.1:${port}`;
  const child = spawn(process.execPath, [VITE, '--host', '127.0.0.1', '--port', String(port), '--strictPort'], { cwd: HERE, stdio: ['ignore', 'ignore', 'inherit'], env: { ...process.env, RIDGECAST: server.http } });
  for (const end = Date.now() + PATIENCE; Date.now() < end && child.exitCode === null; await sleep(100))
    if (await fetch(url).then((r) => r.ok, () => false)) return { url, child };
  throw new Error('vite did not start');
}
