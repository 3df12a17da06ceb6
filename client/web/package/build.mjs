// Makes the package's dist: the interface, the worker, what both need, and types.    node package/build.mjs, in client/web
import { execFileSync } from 'node:child_process';
import { copyFileSync, mkdirSync, rmSync } from 'node:fs';
import { basename, join } from 'node:path';
import { fileURLToPath } from 'node:url';
import { build } from 'esbuild';

const here = fileURLToPath(new URL('.', import.meta.url)), web = join(here, '..'), dist = join(here, 'dist');
rmSync(dist, { recursive: true, force: true });
mkdirSync(dist);

// `import url from 'a.wasm?url'`, as vite has it: a file beside the worker.
const files = {
  name: 'files',
  setup(builder) {
    builder.onResolve({ filter: /\?url$/ }, ({ path, resolveDir }) => ({ namespace: 'beside', path: path.startsWith('.') ? join(resolveDir, path.slice(0, -4)) : join(web, 'node_modules', path.slice(0, -4)) }));
    builder.onLoad({ filter: /.*/, namespace: 'beside' }, ({ path }) => {
      copyFileSync(path, join(dist, basename(path)));
      return { contents: `export default new URL('./${basename(path)}', import.meta.url).href;` };
    });
    builder.onResolve({ filter: /^(fs|path)$/ }, ({ path }) => ({ namespace: 'none', path }));
    builder.onLoad({ filter: /.*/, namespace: 'none' }, () => ({ contents: 'export default {};' }));
  },
};
const options = { bundle: true, format: 'esm', target: 'es2022', minify: true, legalComments: 'none', logLevel: 'warning', plugins: [files] };
await build({ ...options, entryPoints: [join(here, 'index.ts')], outfile: join(dist, 'index.js') });
await build({ ...options, entryPoints: [join(web, 'src/engine.worker.ts')], outfile: join(dist, 'worker.js') });
execFileSync(process.execPath, [join(web, 'node_modules/typescript/bin/tsc'), '-p', join(here, 'tsconfig.json')], { stdio: 'inherit' });
