// Bundles TypeScript tests and runs them with node's own runner: node run-tests.mjs OUT FILE...    Exit code 77: they cannot run here.
import { spawnSync } from 'node:child_process';
import { existsSync, mkdirSync } from 'node:fs';
import { basename, join } from 'node:path';
import { fileURLToPath } from 'node:url';

const here = fileURLToPath(new URL('.', import.meta.url));
const [outdir, ...entryPoints] = process.argv.slice(2);
let build;
try {
  ({ build } = await import('esbuild'));
} catch {
  console.log('SKIPPED: the packages of client/web are not installed; ./run build does that with npm');
  process.exit(77);
}
if (!existsSync(join(here, 'src/generated/core.wasm'))) {
  console.log('SKIPPED: the page is not built; ./run build does that');
  process.exit(77);
}
mkdirSync(outdir, { recursive: true });
await build({ entryPoints, outdir, bundle: true, platform: 'node', target: 'node18', format: 'esm', outExtension: { '.js': '.mjs' }, nodePaths: [join(here, 'node_modules')], sourcemap: 'inline', logLevel: 'warning' });
const files = entryPoints.map((file) => join(outdir, basename(file).replace(/\.ts$/, '.mjs')));
const { status } = spawnSync(process.execPath, ['--enable-source-maps', '--test', ...files], { stdio: 'inherit', env: { ...process.env, RIDGECAST_WEB: here } });
process.exit(status ?? 1);
