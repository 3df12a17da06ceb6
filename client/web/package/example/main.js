// The mesh of a running server in three.js: it follows the camera and everybody's edits. Drag to turn, right button to move, wheel to fly;
// a double click makes a crater.     ?server=ws://127.0.0.1:7070&session=default&x=METRES&z=METRES
import { BufferAttribute, BufferGeometry, Color, DirectionalLight, HemisphereLight, Mesh, MeshStandardMaterial, PerspectiveCamera, Raycaster, Scene, Vector2, WebGLRenderer } from 'three';
import { MapControls } from 'three/addons/controls/MapControls.js';
import { Client, Triangles } from 'ridgecast';

const asked = new URLSearchParams(location.search), origin = { x: Number(asked.get('x') ?? 0), z: Number(asked.get('z') ?? 0) };
const renderer = new WebGLRenderer({ antialias: true, logarithmicDepthBuffer: true });
document.body.append(renderer.domElement);
const scene = new Scene(), sun = new DirectionalLight('white', 2), camera = new PerspectiveCamera(60, 1, 0.5, 60_000);
scene.background = new Color('#a9c4de');
sun.position.set(-1, 1.2, 0.4);
scene.add(sun, new HemisphereLight('#cfe0f5', '#6b5a45', 1.2));
const controls = new MapControls(camera, renderer.domElement);

// All triangles are one geometry, of which an iteration changes a little.
const triangles = new Triangles(origin), mesh = new Mesh(new BufferGeometry(), new MeshStandardMaterial({ color: '#8a8f6a', flatShading: true }));
mesh.frustumCulled = false;
scene.add(mesh);
const client = new Client((message) => message.kind === 'lost' && console.warn(message.sentence));
client.follow((change) => {
  const changed = triangles.apply(change), { geometry } = mesh;
  if (geometry.getAttribute('position')?.array !== triangles.positions) geometry.dispose(), geometry.setAttribute('position', new BufferAttribute(triangles.positions, 3));
  const positions = geometry.getAttribute('position');
  for (const [start, count] of changed) positions.addUpdateRange(start, count);
  positions.needsUpdate = true;
});
client.connect(`${asked.get('server') ?? 'ws://127.0.0.1:7070'}/v1/stream?session=${asked.get('session') ?? 'default'}`, { name: 'three.js', threshold: 1 });

camera.position.set(0, 3000, 0);
controls.target.set(0, 2500, -1500);
function draw() {
  const { innerWidth: width, innerHeight: height } = window, { x, y, z } = camera.position;
  if (renderer.domElement.width !== width || renderer.domElement.height !== height) renderer.setSize(width, height);
  camera.aspect = width / height;
  camera.updateProjectionMatrix();
  controls.update();
  camera.rotation.reorder('YXZ');
  const view = { x: origin.x + x, y, z: origin.z + z, yaw: camera.rotation.y, pitch: camera.rotation.x, verticalFov: (camera.fov * Math.PI) / 180, width, height };
  if (JSON.stringify(view) !== draw.last) client.look(view);
  draw.last = JSON.stringify(view);
  renderer.render(scene, camera);
}
renderer.setAnimationLoop(draw);
renderer.domElement.addEventListener('dblclick', ({ clientX, clientY }) => {
  const ray = new Raycaster();
  ray.setFromCamera(new Vector2((2 * clientX) / innerWidth - 1, 1 - (2 * clientY) / innerHeight), camera);
  const [hit] = ray.intersectObject(mesh);
  if (hit) client.edit({ op: 'crater', x: origin.x + hit.point.x, z: origin.z + hit.point.z, radius: 30, depth: 12 }).catch(({ message }) => console.warn(message));
});
globalThis.ridgecast = { camera, client, controls, draw, mesh, renderer, triangles }; // for the console and tests
