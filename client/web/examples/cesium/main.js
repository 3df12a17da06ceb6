// Flies over a session's ground on Cesium's globe: drag to move, wheel for height, Ctrl and drag to turn.
//   ?session=NAME&x=METRES&z=METRES&at=LON,LAT,HEIGHT   which world, and the place of it that lies at the place on the globe, unless its
//                                                       map says where it lies
/* global Cesium */
import { findPlace, session } from '../place.js';

const asked = new URLSearchParams(location.search);
const { at, longitude, latitude, height } = await findPlace();
const where = new URLSearchParams({ ...(at && { at, x: asked.get('x') ?? 0, z: asked.get('z') ?? 0 }), compression: 'draco' });

const viewer = new Cesium.Viewer('view', {
  animation: false,
  baseLayer: false,
  baseLayerPicker: false,
  fullscreenButton: false,
  geocoder: false,
  globe: false, // the ground is all there is: no imagery, no account
  homeButton: false,
  infoBox: false,
  navigationHelpButton: false,
  sceneModePicker: false,
  selectionIndicator: false,
  skyBox: false,
  skyAtmosphere: false,
  timeline: false,
});
const { camera, scene } = viewer;
scene.backgroundColor = Cesium.Color.fromCssColorString(asked.get('background') ?? '#a9c4de');
if (scene.sun) scene.sun.show = false;
if (scene.moon) scene.moon.show = false;
scene.light = new Cesium.DirectionalLight({ direction: new Cesium.Cartesian3(0, 0, -1), intensity: 3 });

const url = `${session}/3dtiles/tileset.json?${where}`;
async function askAgainIfBusy(resource, { statusCode, responseHeaders }) {
  if (statusCode !== 503) return false;
  await new Promise((done) => setTimeout(done, 1000 * (responseHeaders['retry-after'] ?? 1)));
  Object.assign(resource.request, { throttle: false, throttleByServer: false }); // where there are many, Cesium would take the tile for empty
  return true;
}
const tileset = await Cesium.Cesium3DTileset.fromUrl(new Cesium.Resource({ url, retryAttempts: 100, retryCallback: askAgainIfBusy }), {
  maximumScreenSpaceError: Number(asked.get('error') ?? 8), // pixels
});
const failed = [];
tileset.tileFailed.addEventListener(({ url, message }) => failed.push(`${url}: ${message}`));
scene.primitives.add(tileset);

// From the tangent plane (east, north, up) to the Earth.
const frame = Cesium.Transforms.eastNorthUpToFixedFrame(Cesium.Cartesian3.fromDegrees(longitude, latitude, height));
const onEarth = (vector, how) => Cesium.Matrix4[how](frame, vector, new Cesium.Cartesian3());
scene.light.direction = onEarth(Cesium.Cartesian3.normalize(new Cesium.Cartesian3(1, -0.4, -1.2), new Cesium.Cartesian3()), 'multiplyByPointAsVector');

/** Looks from a place, metres east, north and up of the tangent plane's, by heading and pitch in degrees. */
function look(east, north, up, heading, pitch) {
  camera.setView({
    destination: onEarth(new Cesium.Cartesian3(east, north, up), 'multiplyByPoint'),
    orientation: { heading: Cesium.Math.toRadians(heading), pitch: Cesium.Math.toRadians(pitch), roll: 0 },
  });
}
look(0, -6000, 4000, 0, -20);

// For tests and the console.
globalThis.ridgecast = { Cesium, failed, frame, look, scene, tileset, viewer };
