// Bundles the TypeScript tests for node: node build-tests.mjs OUT FILE...
import { build } from 'esbuild';
const [outdir, ...entryPoints] = process.argv.slice(2);
await build({
  entryPoints,
  outdir,
  bundle: true,
  platform: 'node',
  target: 'node18',
  format: 'esm',
  outExtension: { '.js': '.mjs' },
  nodePaths: [new URL('node_modules', import.meta.url).pathname],
  alias: {},
  sourcemap: 'inline',
  logLevel: 'warning',
});
