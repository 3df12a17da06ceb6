"""The true ground: heights, normals, rays."""

from os import PathLike
from typing import Any, Callable, Mapping, NamedTuple, Optional, Union

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._errors import Invalid
from ._library import check, doubles, ffi, interruptible, lib, owned, places, struct, text
from .server import program
from .standing import Standing


class Hits(NamedTuple):
    """Where rays meet the ground; (...) is the rays' shape."""

    distance: NDArray[np.float64]  #: (...), metres along the ray; inf: no hit
    at: NDArray[np.float64]  #: (..., 3), metres; nan: no hit
    normal: NDArray[np.float64]  #: (..., 3), of the ground there; nan: no hit


class Questions:
    """The queries of both Terrain and World."""

    _terrain: Any

    def _call(self, call: Callable[[], Any]) -> None:
        check(call())

    def heights(self, xz: ArrayLike) -> NDArray[np.float32]:
        """Heights in metres, float32 (...), at places (..., 2)."""
        at = places(xz, 2, "places")
        out = np.empty(at.shape[:-1], np.float32)
        self._call(lambda: lib.rc_terrain_heights(self._terrain, doubles(at), out.size, ffi.from_buffer("float[]", out)))
        return out

    def height(self, x: float, z: float) -> float:
        """The height at one place, metres."""
        return float(self.heights((x, z)))

    def normals(self, xz: ArrayLike, spacing: float = 1 / 16) -> NDArray[np.float32]:
        """Unit normals, float32 (..., 3), at places (..., 2), of the planes through the heights `spacing` metres to each side."""
        at = places(xz, 2, "places")
        out = np.empty(at.shape[:-1] + (3,), np.float32)
        self._call(lambda: lib.rc_terrain_normals(self._terrain, doubles(at), out.size // 3, spacing, ffi.from_buffer("float[]", out)))
        return out

    def rays(self, origins: ArrayLike, directions: ArrayLike, reach: float = 1e5) -> Hits:
        """The first contact of rays with the ground. origins, directions (not 0): (..., 3); reach: metres, at most 1e5.

        Obstacles thinner than a quarter of a metre, or 1/1024 of the distance, may be missed.
        """
        begin, towards = np.broadcast_arrays(places(origins, 3, "origins"), places(directions, 3, "directions"))
        shape = begin.shape[:-1]
        rays = np.concatenate([begin.reshape(-1, 3), towards.reshape(-1, 3), np.full((int(np.prod(shape)), 1), reach)], axis=1)
        out = np.empty((len(rays), 7))
        asked, hits = ffi.cast("rc_ray*", doubles(rays)), ffi.cast("rc_hit*", doubles(out))
        self._call(lambda: lib.rc_terrain_rays(self._terrain, asked, len(rays), hits))
        nowhere = out[:, 0] < 0
        out[nowhere] = np.nan
        out[nowhere, 0] = np.inf
        return Hits(out[:, 0].reshape(shape), out[:, 1:4].reshape(shape + (3,)), out[:, 4:].reshape(shape + (3,)))

    def standing(self, spacing: float = 1.0, radius: Optional[float] = None, memory: int = 50_000_000) -> Standing:
        """Ground under bodies: heights `spacing` metres apart (a multiple of 1/64), `radius` metres around each (default: 32 times the
        spacing), in at most `memory` bytes."""
        return Standing(self._terrain, spacing, 32 * spacing if radius is None else radius, memory)


class Terrain(Questions):
    """A terrain, without a server.

    name: "alpine", "canyon", "archipelago"; a terrain file (.glsl; needs a C++ compiler, and seconds the first time); or a height map
    (.tif, .png, .asc, .hgt, .r16, .raw)
    parameters: values for parameters of a built-in terrain or a terrain file
    raster: options of a height map, such as "pitch=30 nodata=fill"
    """

    def __init__(self, name: "Union[str, PathLike[str]]" = "alpine", seed: int = 1, parameters: Optional[Mapping[str, float]] = None,
                 raster: str = "") -> None:
        if not 1 <= seed < 1 << 32:
            raise Invalid("a seed is 1 to 4294967295")
        kept = [(text(key), float(value)) for key, value in (parameters or {}).items()]
        raster_text, server = text(raster), text(program(required=False))
        options = struct("rc_terrain_options", seed=seed, parameter_count=len(kept), raster=raster_text, program=server)
        values = ffi.new("rc_parameter[]", kept) if kept else ffi.NULL
        options.parameters = values
        out = ffi.new("rc_terrain**")
        spelt = text(name)
        interruptible(lambda: lib.rc_terrain_open(spelt, options, out), lambda: lib.rc_terrain_close(out[0]))
        self._terrain = owned(out[0], lib.rc_terrain_close)
        self.name = str(name)

    @property
    def hash(self) -> int:
        """Equal for equal ground, on every machine."""
        return int(lib.rc_terrain_hash(self._terrain))

    def __repr__(self) -> str:
        return f"<ridgecast.Terrain {self.name}, hash {self.hash:016x}>"
