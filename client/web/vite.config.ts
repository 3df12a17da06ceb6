import { existsSync, readFileSync, readdirSync, statSync, writeFileSync } from 'node:fs';
import { join } from 'node:path';
import { brotliCompressSync, constants, gzipSync } from 'node:zlib';
import { Plugin, defineConfig } from 'vite';

// Compresses what has been built beside itself, once, so that the server need not.
function compressed(): Plugin {
  let out = '';
  return {
    name: 'compressed',
    apply: 'build',
    configResolved(config) {
      out = config.build.outDir;
    },
    closeBundle() {
      for (const entry of readdirSync(out, { recursive: true }) as string[]) {
        const file = join(out, entry);
        if (!statSync(file).isFile() || /\.(br|gz)$/.test(file)) continue;
        const bytes = readFileSync(file);
        const forms: [string, Buffer][] = [
          ['.br', brotliCompressSync(bytes, { params: { [constants.BROTLI_PARAM_QUALITY]: 11, [constants.BROTLI_PARAM_SIZE_HINT]: bytes.length } })],
          ['.gz', gzipSync(bytes, { level: 9 })],
        ];
        for (const [extension, form] of forms) if (form.length < 0.95 * bytes.length) writeFileSync(file + extension, form);
      }
    },
  };
}

// The licences of what is bundled.
function licences(): Plugin {
  return {
    name: 'licences',
    apply: 'build',
    generateBundle() {
      const text = ['three', 'draco3d'].map((name) => {
        const folder = join(__dirname, 'node_modules', name);
        const { version, license } = JSON.parse(readFileSync(join(folder, 'package.json'), 'utf8')) as { version: string; license: string };
        const file = join(folder, 'LICENSE');
        return `${name} ${version}: ${license}\n\n${existsSync(file) ? readFileSync(file, 'utf8') : 'See https://www.apache.org/licenses/LICENSE-2.0\n'}`;
      });
      for (const name of ['libc++-16-dev-wasm32', 'wasi-libc']) {
        const file = `/usr/share/doc/${name}/copyright`;
        if (existsSync(file)) text.push(`${name}:\n\n${readFileSync(file, 'utf8')}`);
      }
      this.emitFile({ type: 'asset', fileName: 'licences.txt', source: text.join('\n\n') });
    },
  };
}

export default defineConfig({
  base: './',
  build: {
    outDir: process.env['RIDGECAST_WEB_OUT'] ?? '../../build/web',
    emptyOutDir: true,
    target: 'es2022',
    assetsInlineLimit: 0, // the page's policy allows no data: addresses
    modulePreload: { polyfill: false },
    chunkSizeWarningLimit: 1000,
  },
  worker: { format: 'es' },
  plugins: [licences(), compressed()],
});
