"""Ground for simulators, as files: a grid of heights, or triangles. In files it lies east, north, up, in metres, around 0, 0."""

import os
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Callable, Dict, List, Tuple, Union

import numpy as np
from numpy.typing import NDArray

from ._errors import Invalid
from .frames import enu

Write = Callable[[Path, NDArray[np.float32], NDArray[np.uint32]], None]


@dataclass(frozen=True)
class Grid:
    """Heights on a grid. Made by `grid` of a terrain or world."""

    heights: NDArray[np.float32]  #: (rows, columns), metres; rows of ascending z, each of ascending x
    spacing: float  #: metres
    center: Tuple[float, float]  #: x, z, metres: 0, 0 in files

    def save(self, path: "Union[str, os.PathLike[str]]") -> None:
        """Writes a file of the kind that its ending names:

        .npz: `heights` (rows from south to north, each from west to east), `spacing`, `center`
        .xml: a model of MuJoCo with the ground as a height field, its heights beside it (.hfield)
        .obj, .usda, .sdf: its squares as two triangles each, as `Mesh.save` writes them
        """
        kind = _kind(path, [".npz", ".xml", *WRITERS])
        if kind == ".npz":
            return np.savez_compressed(path, heights=self.heights[::-1], spacing=self.spacing, center=self.center)
        if kind == ".xml":
            return _save_mujoco(Path(path), self)
        WRITERS[kind](Path(path), *self._triangles())

    def _triangles(self) -> Tuple[NDArray[np.float32], NDArray[np.uint32]]:
        rows, columns = self.heights.shape
        x, z = (self.spacing * (np.arange(n) - (n - 1) / 2) for n in (columns, rows))
        x, z = np.meshgrid(x, z)
        first = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).reshape(-1, 1)
        squares = first + np.array([0, columns, 1, 1, columns, columns + 1])
        return enu(np.stack([x, self.heights, z], axis=-1)).reshape(-1, 3).astype(np.float32), squares.reshape(-1, 3).astype(np.uint32)


def save_triangles(path: "Union[str, os.PathLike[str]]", positions: NDArray[np.float32], triangles: NDArray[np.uint32]) -> None:
    WRITERS[_kind(path, list(WRITERS))](Path(path), enu(positions).astype(np.float32), triangles)


def _kind(path: "Union[str, os.PathLike[str]]", kinds: List[str]) -> str:
    kind = Path(path).suffix
    if kind not in kinds:
        raise Invalid(f"the file's name ends with {', '.join(kinds)}, not {kind!r}")
    return kind


def _save_mujoco(path: Path, grid: Grid) -> None:
    rows, columns = grid.heights.shape
    low, high = float(grid.heights.min()), float(grid.heights.max())
    beside = path.with_suffix(".hfield")
    beside.write_bytes(struct.pack("<ii", rows, columns) + np.ascontiguousarray(grid.heights[::-1], "<f4").tobytes())
    half = [grid.spacing * (n - 1) / 2 for n in (columns, rows)]
    # MuJoCo makes heights 0 to 1, and wants them to differ.
    path.write_text(f'''<mujoco model="{_escaped(path.stem)}">
  <asset>
    <hfield name="ground" file="{_escaped(beside.name)}" size="{half[0]!r} {half[1]!r} {max(high - low, 1e-6)!r} 1"/>
  </asset>
  <worldbody>
    <geom name="ground" type="hfield" hfield="ground" pos="0 0 {low!r}"/>
  </worldbody>
</mujoco>
''')


def _save_obj(path: Path, positions: NDArray[np.float32], triangles: NDArray[np.uint32]) -> None:
    with open(path, "w") as out:
        np.savetxt(out, positions, "v %.9g %.9g %.9g")
        np.savetxt(out, triangles.astype(np.int64) + 1, "f %d %d %d")


def _save_sdf(path: Path, positions: NDArray[np.float32], triangles: NDArray[np.uint32]) -> None:
    beside = path.with_suffix(".obj")
    _save_obj(beside, positions, triangles)
    mesh = f"<geometry><mesh><uri>{_escaped(beside.name)}</uri></mesh></geometry>"
    path.write_text(f'''<?xml version="1.0"?>
<sdf version="1.9">
  <model name="{_escaped(path.stem)}">
    <static>true</static>
    <link name="ground">
      <collision name="collision">{mesh}</collision>
      <visual name="visual">{mesh}</visual>
    </link>
  </model>
</sdf>
''')


def _save_usd(path: Path, positions: NDArray[np.float32], triangles: NDArray[np.uint32]) -> None:
    points = ", ".join("(%.9g, %.9g, %.9g)" % tuple(p) for p in positions.tolist())
    path.write_text(f'''#usda 1.0
(
    defaultPrim = "ground"
    metersPerUnit = 1
    upAxis = "Z"
)

def Mesh "ground" (
    prepend apiSchemas = ["PhysicsCollisionAPI", "PhysicsMeshCollisionAPI"]
)
{{
    uniform token physics:approximation = "none"
    uniform token subdivisionScheme = "none"
    int[] faceVertexCounts = [{", ".join(["3"] * len(triangles))}]
    int[] faceVertexIndices = [{", ".join(map(str, triangles.ravel().tolist()))}]
    point3f[] points = [{points}]
}}
''')


def _escaped(name: str) -> str:
    return name.replace("&", "&amp;").replace("<", "&lt;").replace('"', "&quot;")


WRITERS: Dict[str, Write] = {".obj": _save_obj, ".usda": _save_usd, ".sdf": _save_sdf}
