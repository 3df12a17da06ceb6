"""Triangles of the ground."""

import os
from dataclasses import dataclass
from typing import Any, Tuple, Union

import numpy as np
from numpy.typing import NDArray

from ._library import ffi, lib, owned
from .grid import save_triangles


@dataclass(frozen=True)
class Mesh:
    """Triangles, counter-clockwise from above.

    positions: float32 (n, 3), metres: x and z from `origin`, y absolute; exact within 65 km of the origin
    triangles: uint32 (m, 3), indices of rows of `positions`
    origin: x, z of the origin, metres
    error: metres, how far the true ground is above or below at most; inf: not known (of a world's mesh: join(errors=True))
    """

    positions: NDArray[np.float32]
    triangles: NDArray[np.uint32]
    origin: Tuple[float, float]
    error: float

    def save(self, path: "Union[str, os.PathLike[str]]") -> None:
        """Writes a file of the kind that its ending names, with `origin` at 0, 0: .obj, .usda (USD, a static collider), .sdf (a static model
        for Gazebo, its triangles in an .obj beside it)."""
        save_triangles(path, self.positions, self.triangles)


def take(handle: Any) -> Mesh:
    """The Mesh of a `const rc_mesh*`. Its arrays are used without a copy and live as long as an array over them."""
    owner = owned(handle, lib.rc_mesh_close)

    def array(pointer: Any, count: int, kind: Any) -> Any:
        if count == 0:
            return np.empty((0, 3), kind)
        out = np.frombuffer(_Memory(owner, pointer, 12 * count), kind).reshape(count, 3)
        out.flags.writeable = False
        return out

    return Mesh(array(owner.positions, owner.vertex_count, np.float32), array(owner.triangles, owner.triangle_count, np.uint32),
                (owner.origin[0], owner.origin[1]), owner.error)


def _Memory(owner: Any, pointer: Any, size: int) -> Any:
    return ffi.buffer(ffi.gc(ffi.cast("char*", pointer), lambda _: owner), size)
