// Flies over a session's ground with three.js: drag to move, right button to turn, wheel for height.
//   ?session=NAME&x=METRES&z=METRES   which world, and the place of it that lies at three's origin
//   &compression=none                 for a reader without Draco; normals, colours and materials as for a snapshot
// A click says what the ground is made of there.
//   ?tileset=URL                      instead: a tileset anywhere, such as of `ridgecast-client snapshot --tiles`, on its own axes
import { TilesRenderer } from '3d-tiles-renderer';
import { GLTFExtensionsPlugin } from '3d-tiles-renderer/plugins';
import { AmbientLight, Color, DirectionalLight, Euler, LoadingManager, MathUtils, PerspectiveCamera, Raycaster, Scene, Vector2, Vector3, WebGLRenderer } from 'three';
import { MapControls } from 'three/addons/controls/MapControls.js';
import { DRACOLoader } from 'three/addons/loaders/DRACOLoader.js';
import dracoWrapper from 'three/examples/jsm/libs/draco/gltf/draco_wasm_wrapper.js?url';
import dracoDecoder from 'three/examples/jsm/libs/draco/gltf/draco_decoder.wasm?url';

const asked = new URLSearchParams(location.search);
const where = new URLSearchParams({ x: asked.get('x') ?? 0, z: asked.get('z') ?? 0, compression: asked.get('compression') ?? 'draco', materials: 1 });
for (const name of ['normals', 'colours', 'materials']) if (asked.has(name)) where.set(name, asked.get(name));

const renderer = new WebGLRenderer({ antialias: true, logarithmicDepthBuffer: true }); // it sees from metres to 200 km
document.querySelector('#view').append(renderer.domElement);
const scene = new Scene();
scene.background = new Color(asked.get('background') ?? '#a9c4de');
const sun = new DirectionalLight('white', 3);
sun.position.set(-1, 1.2, 0.4);
scene.add(sun, new AmbientLight('#b0c8e8', 1));

const camera = new PerspectiveCamera(60, 1, 0.1, 1e6);
const controls = new MapControls(camera, renderer.domElement);

/** Looks from a place, metres east, north and up of three's origin, by heading and pitch in degrees. */
function look(east, north, up, heading, pitch) {
  camera.position.set(east, up, -north);
  const ahead = new Vector3(0, 0, -1000).applyEuler(new Euler(pitch * MathUtils.DEG2RAD, -heading * MathUtils.DEG2RAD, 0, 'YXZ'));
  controls.target.copy(camera.position).add(ahead);
}
look(0, -6000, 4000, 0, -20);

const tiles = new TilesRenderer(asked.get('tileset') ?? `/v1/sessions/${asked.get('session') ?? 'default'}/3dtiles/tileset.json?${where}`);
tiles.errorTarget = Number(asked.get('error') ?? 8); // pixels
tiles.group.rotation.x = -Math.PI / 2; // 3D Tiles have z up, three.js has y
tiles.setCamera(camera);
scene.add(tiles.group);
const dracoFiles = new LoadingManager().setURLModifier((url) => (url.endsWith('.js') ? dracoWrapper : dracoDecoder));
tiles.registerPlugin(new GLTFExtensionsPlugin({ dracoLoader: new DRACOLoader(dracoFiles) }));
tiles.registerPlugin({
  name: 'PATIENT',
  async fetchData(url, options) {
    for (;;) {
      const answer = await fetch(url, options);
      if (answer.status !== 503) return answer;
      await new Promise((done) => setTimeout(done, 1000 * (answer.headers.get('Retry-After') ?? 1))); // the server is busy
    }
  },
});
const failed = [];
tiles.addEventListener('load-error', ({ url, error }) => failed.push(`${url}: ${error.message}`));

/** What the ground is made of where the canvas shows it, by the tile's own table of names; '': there is sky, or it is not said. */
function groundAt(x, y) {
  const ray = new Raycaster();
  ray.setFromCamera(new Vector2((2 * x) / innerWidth - 1, 1 - (2 * y) / innerHeight), camera);
  const [hit] = ray.intersectObject(tiles.group);
  const { meshFeatures, structuralMetadata } = hit?.object.userData ?? {};
  if (!meshFeatures) return '';
  const [row] = meshFeatures.getFeatures(hit.faceIndex, hit.barycoord), [{ propertyTable }] = meshFeatures.getFeatureInfo();
  return row === null ? '' : structuralMetadata.getPropertyTableData(propertyTable, row).name;
}
renderer.domElement.addEventListener('click', (click) => (document.querySelector('#ground').textContent = groundAt(click.clientX, click.clientY)));

function fit() {
  renderer.setSize(innerWidth, innerHeight);
  camera.aspect = innerWidth / innerHeight;
  camera.updateProjectionMatrix();
  tiles.setResolutionFromRenderer(camera, renderer);
}
addEventListener('resize', fit);
fit();

function draw() {
  controls.update();
  camera.updateMatrixWorld();
  tiles.update();
  renderer.render(scene, camera);
}
renderer.setAnimationLoop(draw);

// For tests and the console.
globalThis.ridgecast = { camera, draw, failed, groundAt, look, renderer, scene, tiles };
