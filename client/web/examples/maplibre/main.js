// A session's world as the terrain of a MapLibre map: ?session=NAME&at=LON,LAT, where the world's origin lies on Earth, unless its map says so.
import maplibregl from 'maplibre-gl';
import 'maplibre-gl/dist/maplibre-gl.css';
import { findPlace, session } from '../place.js';

const wanted = new URLSearchParams(location.search);
const { at, longitude, latitude } = await findPlace();
const list = (kind) => `${location.origin}${session}/${kind}/tiles.json${at && `?at=${longitude},${latitude}`}`;
const heights = { type: 'raster-dem', url: list('heights'), tileSize: 256 };

const map = new maplibregl.Map({
  container: 'map',
  center: [longitude, latitude],
  zoom: 12.5,
  pitch: 70,
  bearing: 20,
  maxPitch: 85,
  hash: true,
  canvasContextAttributes: { preserveDrawingBuffer: wanted.has('picture') },
  style: {
    version: 8,
    sources: {
      ground: heights,
      relief: heights, // hillshade wants a source of its own
      colours: { type: 'raster', url: list('colours'), tileSize: 256 },
    },
    layers: [
      { id: 'colours', type: 'raster', source: 'colours' },
      { id: 'relief', type: 'hillshade', source: 'relief', paint: { 'hillshade-exaggeration': 0.4 } },
    ],
    terrain: { source: 'ground', exaggeration: 1 },
    sky: { 'sky-color': '#7fa8d6', 'horizon-color': '#dfe8f2', 'fog-color': '#dfe8f2', 'fog-ground-blend': 0.8 },
  },
});
map.addControl(new maplibregl.NavigationControl({ visualizePitch: true }));
globalThis.map = map; // for the console, and for tests
