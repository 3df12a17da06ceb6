// The only door to Draco: a WebAssembly module, fetched when the first Draco payload comes. Runs in a worker.

import type { DracoDecode } from './leaf';
import { Refusal } from './mesh';

interface DracoModule {
  HEAPU32: Uint32Array;
  HEAP32: Int32Array;
  _malloc(size: number): number;
  _free(at: number): void;
  Decoder: new () => DracoDecoder;
  DecoderBuffer: new () => { Init(bytes: Int8Array | Uint8Array, length: number): void };
  Mesh: new () => DracoMesh;
  destroy(object: unknown): void;
  POSITION: number;
  DT_INT32: number;
}
interface DracoMesh {
  num_points(): number;
  num_faces(): number;
  num_attributes(): number;
}
interface DracoAttribute {
  num_components(): number;
  data_type(): number;
}
interface DracoDecoder {
  DecodeBufferToMesh(buffer: unknown, mesh: DracoMesh): { ok(): boolean };
  GetAttribute(mesh: DracoMesh, k: number): DracoAttribute;
  GetAttributeDataArrayForAllPoints(mesh: DracoMesh, attribute: DracoAttribute, type: number, bytes: number, to: number): boolean;
  GetTrianglesUInt32Array(mesh: DracoMesh, bytes: number, to: number): boolean;
}

export type DracoFactory = (options: { wasmBinary: ArrayBuffer }) => Promise<DracoModule>;

export async function loadDraco(factory: DracoFactory, wasmBinary: ArrayBuffer): Promise<DracoDecode> {
  const module = await factory({ wasmBinary });
  const decoder = new module.Decoder();
  return (bytes, triangles) => {
    const buffer = new module.DecoderBuffer(), mesh = new module.Mesh();
    let room = 0;
    try {
      buffer.Init(bytes, bytes.length);
      if (!decoder.DecodeBufferToMesh(buffer, mesh).ok()) throw new Refusal('its Draco stream is damaged');
      const count = mesh.num_points();
      if (mesh.num_faces() !== triangles || count > 3 * triangles || mesh.num_attributes() !== 1)
        throw new Refusal('its Draco stream does not have the announced counts');
      const attribute = decoder.GetAttribute(mesh, 0);
      if (attribute.num_components() !== 3) throw new Refusal('its Draco stream has no positions');
      room = module._malloc(12 * Math.max(count, triangles));
      if (!decoder.GetAttributeDataArrayForAllPoints(mesh, attribute, module.DT_INT32, 12 * count, room))
        throw new Refusal('its Draco stream is damaged');
      const points = module.HEAP32.slice(room >> 2, (room >> 2) + 3 * count);
      if (!decoder.GetTrianglesUInt32Array(mesh, 12 * triangles, room)) throw new Refusal('its Draco stream is damaged');
      const faces = module.HEAPU32.slice(room >> 2, (room >> 2) + 3 * triangles);
      for (const v of faces) if (v >= count) throw new Refusal('a triangle names a vertex that is not there');
      return { points, triangles: faces };
    } finally {
      if (room) module._free(room);
      module.destroy(mesh);
      module.destroy(buffer);
    }
  };
}
