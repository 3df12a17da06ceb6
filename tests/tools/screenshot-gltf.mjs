// What three.js in a headless Chromium makes of .glb files, each seen by its own camera:
//   screenshot-gltf.mjs FILE.glb ... writes FILE.glb.png beside each. Packages: the folder in TESTS_NODE_TOOLS.
import { createServer } from 'node:http';
import { readFileSync, writeFileSync } from 'node:fs';
import { createRequire } from 'node:module';

const tools = process.env.TESTS_NODE_TOOLS;
const { chromium } = createRequire(`${tools}/`)('playwright-core');
const [width, height] = [640, 360];
const files = process.argv.slice(2);

const page = `<!doctype html><style>body{margin:0}</style><canvas id="c" width="${width}" height="${height}"></canvas>
<script type="importmap">{"imports":{"three":"/three/build/three.module.js","three/addons/":"/three/examples/jsm/"}}</script>
<script type="module">
import * as THREE from 'three';
import { GLTFLoader } from 'three/addons/loaders/GLTFLoader.js';
import { DRACOLoader } from 'three/addons/loaders/DRACOLoader.js';
window.draw = async (file) => {
  const loader = new GLTFLoader().setDRACOLoader(new DRACOLoader().setDecoderPath('/three/examples/jsm/libs/draco/gltf/'));
  const gltf = await loader.loadAsync(file);
  const renderer = new THREE.WebGLRenderer({ canvas: document.getElementById('c'), antialias: true, preserveDrawingBuffer: true });
  const scene = new THREE.Scene();
  scene.background = new THREE.Color(0x9db8d4);
  scene.add(gltf.scene, new THREE.HemisphereLight(0xcfe2ff, 0x4a4338, 1.2));
  const sun = new THREE.DirectionalLight(0xfff1d8, 3);
  sun.position.set(0.56, 0.54, -0.63);
  scene.add(sun);
  let camera = gltf.cameras[0];
  if (camera) {
    gltf.scenes[1].updateMatrixWorld(true);
  } else {  // a box: from above one of its corners
    const box = new THREE.Box3().setFromObject(gltf.scene), size = box.getSize(new THREE.Vector3()), centre = box.getCenter(new THREE.Vector3());
    camera = new THREE.PerspectiveCamera(50, ${width / height}, 1, 1e5);
    camera.position.set(centre.x + size.x * 0.7, box.max.y + size.x * 0.5, centre.z + size.z * 0.9);
    camera.lookAt(centre);
    camera.updateMatrixWorld(true);
  }
  camera.aspect = ${width / height};
  camera.updateProjectionMatrix();
  renderer.render(scene, camera);
  let triangles = 0;
  gltf.scene.traverse((o) => { if (o.isMesh) triangles += o.geometry.index.count / 3; });
  return { triangles, picture: renderer.domElement.toDataURL('image/png') };
};
window.ready = true;
</script>`;

const types = { js: 'text/javascript', wasm: 'application/wasm', glb: 'model/gltf-binary' };
const server = createServer((request, response) => {
  const path = new URL(request.url, 'http://x').pathname;
  if (path === '/favicon.ico') return response.writeHead(204).end();
  try {
    const body = path === '/' ? page : readFileSync(path.startsWith('/file/') ? files[Number(path.slice(6))] : `${tools}/node_modules${path}`);
    response.writeHead(200, { 'Content-Type': path === '/' ? 'text/html' : types[path.split('.').pop()] ?? 'application/octet-stream' }).end(body);
  } catch {
    response.writeHead(404).end();
  }
}).listen(0, '127.0.0.1');
await new Promise((resolve) => server.once('listening', resolve));

const browser = await chromium.launch({
  executablePath: process.env.CHROMIUM ?? '/usr/bin/chromium',
  args: ['--headless', '--no-sandbox', '--use-gl=angle', '--use-angle=swiftshader', '--enable-unsafe-swiftshader', '--disable-quic', '--no-first-run',
    '--disable-background-networking', '--disable-component-update', '--disable-sync'],
  timeout: 180_000,
});
let failed = false;
try {
  for (const [k, file] of files.entries()) {
    const tab = await browser.newPage({ viewport: { width, height } });
    tab.setDefaultTimeout(180_000); // only there to end what hangs
    tab.on('pageerror', (e) => { failed = true; console.log(`${file}: ${e.message}`); });
    tab.on('console', (m) => { if (m.type() === 'error') { failed = true; console.log(`${file}: ${m.text()}`); } });
    await tab.goto(`http://127.0.0.1:${server.address().port}/`);
    await tab.waitForFunction('window.ready');
    const { triangles, picture } = await tab.evaluate((n) => window.draw(`/file/${n}`), k);
    writeFileSync(`${file}.png`, Buffer.from(picture.split(',')[1], 'base64'));
    console.log(`${file}: ${triangles} triangles drawn`);
    await tab.close();
  }
} finally {
  await browser.close();
  server.close();
}
process.exit(failed ? 1 : 0);
