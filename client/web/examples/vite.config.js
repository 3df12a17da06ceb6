import { fileURLToPath } from 'node:url';
import { defineConfig } from 'vite';

const file = (name) => fileURLToPath(new URL(name, import.meta.url));

// All pages ask the address that they come from, so that none needs --allow-origin.
const proxy = { '/v1': { target: process.env.RIDGECAST ?? 'http://127.0.0.1:7070', changeOrigin: false } };

export default defineConfig({
  publicDir: 'node_modules/cesium/Build/Cesium', // CesiumJS loads its workers from here
  server: { proxy },
  preview: { proxy },
  optimizeDeps: { include: ['three', 'three/addons/controls/MapControls.js', '3d-tiles-renderer'] },
  build: {
    outDir: '../../../build/examples',
    emptyOutDir: true,
    target: 'es2022',
    chunkSizeWarningLimit: 2000,
    rollupOptions: { input: [file('index.html'), file('three/index.html'), file('cesium/index.html'), file('maplibre/index.html')] },
  },
});
