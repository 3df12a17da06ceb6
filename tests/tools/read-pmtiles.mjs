// Reads a PMTiles archive by the format's own library: prints its header and metadata, then the SHA-256 of each tile that its levels and
// bounds have room for, or null where there is none. Run: node read-pmtiles.mjs FILE
import { createHash } from 'node:crypto';
import { open } from 'node:fs/promises';
import { createRequire } from 'node:module';
import { pathToFileURL } from 'node:url';

const require = createRequire(`${process.env.TESTS_NODE_TOOLS}/package.json`);
const { PMTiles } = await import(pathToFileURL(require.resolve('pmtiles')).href);

const file = await open(process.argv[2]);
const archive = new PMTiles({
  getKey: () => process.argv[2],
  getBytes: async (offset, length) => {
    const { buffer, bytesRead } = await file.read(Buffer.alloc(length), 0, length, offset);
    return { data: buffer.buffer.slice(buffer.byteOffset, buffer.byteOffset + bytesRead) };
  },
});

const header = await archive.getHeader();
const column = (longitude, level) => Math.floor((longitude / 360 + 0.5) * 2 ** level);
const row = (latitude, level) => Math.floor((0.5 - Math.asinh(Math.tan((latitude * Math.PI) / 180)) / (2 * Math.PI)) * 2 ** level);
const tiles = {};
for (let z = header.minZoom; z <= header.maxZoom; ++z)
  for (let x = column(header.minLon, z); x <= column(header.maxLon, z); ++x)
    for (let y = row(header.maxLat, z); y <= row(header.minLat, z); ++y) {
      const tile = await archive.getZxy(z, x, y);
      tiles[`${z}/${x}/${y}`] = tile ? createHash('sha256').update(new Uint8Array(tile.data)).digest('hex') : null;
    }
console.log(JSON.stringify({ header, metadata: await archive.getMetadata(), tiles }));
