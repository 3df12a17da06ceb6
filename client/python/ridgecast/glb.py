"""Reads snapshots that a server made."""

import json
import struct
from os import PathLike
from pathlib import Path
from typing import Any, List, Union

import numpy as np
from numpy.typing import NDArray

from ._errors import Invalid
from .mesh import Mesh

_KINDS = {5120: np.int8, 5121: np.uint8, 5122: np.int16, 5123: np.uint16, 5125: np.uint32, 5126: np.float32}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}


def read_glb(file: "Union[str, PathLike[str], bytes]") -> Mesh:
    """The triangles of an uncompressed binary glTF file, given as a path or as bytes. Normals and colours are left out.

    All primitives become one mesh, with their nodes' translations. Its origin and error are those of the snapshot's metadata; without
    metadata (0, 0) and inf.
    """
    data = file if isinstance(file, bytes) else Path(file).read_bytes()
    try:
        return _read(data)
    except (AttributeError, IndexError, KeyError, RecursionError, TypeError, struct.error, ValueError) as e:
        raise e if isinstance(e, Invalid) else Invalid(f"this binary glTF file is damaged: {type(e).__name__} {e}") from None


def _read(data: bytes) -> Mesh:
    magic, gltf_version, length, size, kind = struct.unpack_from("<4sIII4s", data)
    if magic != b"glTF" or gltf_version != 2 or kind != b"JSON" or length > len(data):
        raise Invalid("this is not a whole binary glTF 2.0 file")
    gltf = json.loads(data[20:20 + size])
    if gltf.get("extensionsRequired"):
        raise Invalid(f"this file needs {', '.join(gltf['extensionsRequired'])}: ask for a snapshot without compression")
    chunk = memoryview(data)[20 + size + 8:]

    def accessor(number: int) -> NDArray[Any]:
        a = gltf["accessors"][number]
        view = gltf["bufferViews"][a["bufferView"]]
        item = np.dtype(_KINDS[a["componentType"]]).newbyteorder("<")
        width = _WIDTHS[a["type"]]
        size = item.itemsize * width
        begin = view.get("byteOffset", 0) + a.get("byteOffset", 0)
        stride = view.get("byteStride", size)
        if a["count"] < 1 or begin < 0 or stride < size or begin + stride * (a["count"] - 1) + size > len(chunk):
            raise Invalid("an accessor lies beyond the file")
        return np.ndarray((a["count"], width), item, chunk, begin, (stride, item.itemsize))

    positions: List[NDArray[np.float32]] = []
    triangles: List[NDArray[np.uint32]] = []
    before = 0
    for node in gltf["nodes"]:
        if "mesh" not in node:
            continue
        for primitive in gltf["meshes"][node["mesh"]]["primitives"]:
            if primitive.get("mode", 4) != 4:
                continue
            at = accessor(primitive["attributes"]["POSITION"]).astype(np.float64) + node.get("translation", (0, 0, 0))
            index = accessor(primitive["indices"]).astype(np.uint32).reshape(-1, 3) if "indices" in primitive else np.arange(
                len(at), dtype=np.uint32).reshape(-1, 3)
            if index.size and index.max() >= len(at):
                raise Invalid("a triangle names a vertex that is not there")
            positions.append(at.astype(np.float32))
            triangles.append(index + np.uint32(before))
            before += len(at)
    extras = gltf["asset"].get("extras", {})
    error = extras.get("error", {}) if isinstance(extras, dict) else {}
    origin = extras.get("origin", {}) if isinstance(extras, dict) else {}
    kept = error.get("kept", np.inf) if isinstance(error, dict) else error
    return Mesh(np.concatenate(positions) if positions else np.empty((0, 3), np.float32),
                np.concatenate(triangles) if triangles else np.empty((0, 3), np.uint32),
                (float(origin.get("x", 0)), float(origin.get("z", 0))), float(kept))
