"""The true ground: heights, normals, rays."""

import time
from os import PathLike
from typing import Any, Callable, Mapping, NamedTuple, Optional, Tuple, Union

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._errors import Invalid
from ._library import check, doubles, ffi, interruptible, lib, owned, places, real, struct, text
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

    def _call(self, count: int, call: Callable[[int, int], Any]) -> None:
        """Calls for `count` places, for so many at a time as take some 10 ms: Ctrl-C works in between. `call` has the first and how many."""
        first, some = 0, 64
        while True:
            began = time.perf_counter()
            check(call(first, min(some, count - first)))
            first += some
            if first >= count:
                return
            some = some * 2 if time.perf_counter() - began < 0.01 else max(1, some // 2)

    def heights(self, xz: ArrayLike) -> NDArray[np.float32]:
        """Heights in metres, float32 (...), at places (..., 2)."""
        at = places(xz, 2, "places")
        out = np.empty(at.shape[:-1], np.float32)
        asked, heights = doubles(at), ffi.from_buffer("float[]", out)
        self._call(out.size, lambda first, n: lib.rc_terrain_heights(self._terrain, asked + 2 * first, n, heights + first))
        return out

    def height(self, x: float, z: float) -> float:
        """The height at one place, metres."""
        return float(self.heights((x, z)))

    def normals(self, xz: ArrayLike, spacing: float = 1 / 16) -> NDArray[np.float32]:
        """Unit normals, float32 (..., 3), at places (..., 2), of the planes through the heights `spacing` metres to each side."""
        at = places(xz, 2, "places")
        out = np.empty(at.shape[:-1] + (3,), np.float32)
        asked, normals = doubles(at), ffi.from_buffer("float[]", out)
        self._call(out.size // 3,
                   lambda first, n: lib.rc_terrain_normals(self._terrain, asked + 2 * first, n, spacing, normals + 3 * first))
        return out

    def rays(self, origins: ArrayLike, directions: ArrayLike, reach: ArrayLike = 1e5) -> Hits:
        """The first contact of rays with the ground. origins, directions (not 0): (..., 3); reach: metres, at most 1e5, of all or each (...).

        Missed only where the ray is in the ground for less than 1/64 m, or 1/16384 of the distance: proven for height maps and edits,
        measured for built-in terrains. Terrains of GLSL files are sampled every 1/4 m, or 1/1024 of the distance, and any thinner obstacle
        may be missed.
        """
        begin, towards = np.broadcast_arrays(places(origins, 3, "origins"), places(directions, 3, "directions"))
        shape = begin.shape[:-1]
        try:
            reaches = np.broadcast_to(real(reach, "reaches"), shape)
        except ValueError:
            raise Invalid(f"a reach is one number, or an array of the rays' shape, {shape}") from None
        rays = np.concatenate([begin.reshape(-1, 3), towards.reshape(-1, 3), reaches.reshape(-1, 1)], axis=1)
        out = np.empty((len(rays), 7))
        asked, answers = doubles(rays), doubles(out)  # which the call keeps, also where it goes on after Ctrl-C
        self._call(len(rays), lambda first, n: lib.rc_terrain_rays(
            self._terrain, ffi.cast("rc_ray*", asked + 7 * first), n, ffi.cast("rc_hit*", answers + 7 * first)))
        nowhere = out[:, 0] < 0
        out[nowhere] = np.nan
        out[nowhere, 0] = np.inf
        return Hits(out[:, 0].reshape(shape), out[:, 1:4].reshape(shape + (3,)), out[:, 4:].reshape(shape + (3,)))

    def standing(self, spacing: float = 1.0, radius: Optional[float] = None, memory: int = 50_000_000) -> Standing:
        """Ground under bodies: heights `spacing` metres apart (a multiple of 1/64), `radius` metres around each (default: 32 times the
        spacing), in at most `memory` bytes."""
        made = Standing(self._terrain, spacing, 32 * spacing if radius is None else radius, memory)
        self._stand(made)
        return made

    def _stand(self, ground: Standing) -> None:
        """It was made."""


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
        self.seed = seed
        self.parameters = dict(parameters or {})
        self.raster = raster

    @property
    def hash(self) -> int:
        """Equal for equal ground, on every machine."""
        return int(lib.rc_terrain_hash(self._terrain))

    def __repr__(self) -> str:
        given = "".join(f", {key}={value!r}" for key, value in self.parameters.items())
        return f"<ridgecast.Terrain {self.name}, seed {self.seed}{given}, hash {self.hash:016x}>"

    def __eq__(self, other: object) -> bool:
        """Equal ground."""
        return isinstance(other, Terrain) and self.hash == other.hash

    def __hash__(self) -> int:
        return self.hash

    def __reduce__(self) -> Tuple[Any, ...]:  # opened again by the process that reads it
        return Terrain, (self.name, self.seed, self.parameters, self.raster)

    def __copy__(self) -> "Terrain":  # it never changes
        return self

    def __deepcopy__(self, memo: object) -> "Terrain":
        return self
