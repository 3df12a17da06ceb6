// Draco's own WebAssembly module, which decodes the core's Draco streams. Runs in a worker.

/** Faces and the integer attribute of a stream; nothing: it is damaged, or has no such attribute or another number of faces. */
export type DracoDecode = (bytes: Uint8Array, triangles: number) => { points: Uint32Array; triangles: Uint32Array } | undefined;

interface DracoModule {
  HEAPU32: Uint32Array;
  _malloc(size: number): number;
  _free(at: number): void;
  Decoder: new () => DracoDecoder;
  DecoderBuffer: new () => { Init(bytes: Int8Array | Uint8Array, length: number): void };
  Mesh: new () => DracoMesh;
  destroy(object: unknown): void;
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
      if (!decoder.DecodeBufferToMesh(buffer, mesh).ok()) return undefined;
      const count = mesh.num_points();
      if (mesh.num_faces() !== triangles || count > 3 * triangles || mesh.num_attributes() !== 1) return undefined;
      const attribute = decoder.GetAttribute(mesh, 0);
      if (attribute.num_components() !== 3) return undefined;
      room = module._malloc(12 * Math.max(count, triangles));
      const numbers = (n: number): Uint32Array => module.HEAPU32.slice(room >> 2, (room >> 2) + 3 * n);
      if (!decoder.GetAttributeDataArrayForAllPoints(mesh, attribute, module.DT_INT32, 12 * count, room)) return undefined;
      const points = numbers(count);
      return decoder.GetTrianglesUInt32Array(mesh, 12 * triangles, room) ? { points, triangles: numbers(triangles) } : undefined;
    } finally {
      if (room) module._free(room);
      module.destroy(mesh);
      module.destroy(buffer);
    }
  };
}
