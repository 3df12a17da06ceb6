import { defineConfig } from 'vite';

// The page asks the address that it comes from, so that it needs no --allow-origin.
const proxy = { '/v1': process.env.RIDGECAST ?? 'http://127.0.0.1:7070' };

export default defineConfig({ server: { proxy }, preview: { proxy }, build: { outDir: '../../../../build/maplibre', emptyOutDir: true, chunkSizeWarningLimit: 2000 } });
