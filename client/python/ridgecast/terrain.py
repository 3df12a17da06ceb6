"""The true ground: heights, normals, materials, rays."""

import math
import os
import threading
import time
from os import PathLike
from typing import Any, Callable, List, Mapping, NamedTuple, Optional, Tuple, Union

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._errors import Invalid
from ._library import check, doubles, ffi, interruptible, lib, owned, places, real, struct, text
from .grid import Grid
from .scan import Scan, turned
from .server import program
from .standing import Standing


class Hits(NamedTuple):
    """Where rays meet the ground; (...) is the rays' shape."""

    distance: NDArray[np.float64]  #: (...), metres along the ray; inf: no hit
    at: NDArray[np.float64]  #: (..., 3), metres; nan: no hit
    normal: NDArray[np.float64]  #: (..., 3), of the ground there; nan: no hit


def room(out: Optional[NDArray[np.float32]], shape: Tuple[int, ...]) -> NDArray[np.float32]:
    """Where numbers are written to that the library makes."""
    if out is None:
        return np.empty(shape, np.float32)
    if not (isinstance(out, np.ndarray) and out.dtype == np.float32 and out.shape == shape and out.flags.c_contiguous and out.flags.writeable):
        raise Invalid(f"out is a contiguous array of float32 that may be written to, of shape {shape}")
    return out


class Questions:
    """The queries of both Terrain and World."""

    _terrain: Any
    _threads = 1  # that a long call takes

    def _call(self, count: int, call: Callable[[int, int], Any]) -> None:
        """Calls for `count` places, for so many at a time as take some 10 ms: Ctrl-C works in between. `call` has the first and how many."""
        first, some = 0, 64
        while True:
            began = time.perf_counter()
            check(call(first, min(some, count - first)))
            first += some
            if first >= count:
                return
            if time.perf_counter() - began < 0.01:
                some *= 2
            elif self._threads > 1 and count - first > some:
                return self._share(first, some, count, call)
            else:
                some = max(1, some // 2)

    def _share(self, first: int, some: int, count: int, call: Callable[[int, int], Any]) -> None:
        turns = threading.Lock()
        failures: List[BaseException] = []

        def work() -> None:
            nonlocal first
            try:
                while not failures:
                    with turns:
                        begin, first = first, first + some
                    if begin >= count:
                        return
                    check(call(begin, min(some, count - begin)))
            except BaseException as e:
                failures.append(e)

        others = [threading.Thread(target=work, daemon=True) for _ in range(self._threads - 1)]
        for other in others:
            other.start()
        work()
        for other in others:
            other.join()
        if failures:
            raise failures[0].with_traceback(None)

    def heights(self, xz: ArrayLike, out: Optional[NDArray[np.float32]] = None) -> NDArray[np.float32]:
        """Heights in metres, float32 (...), at places (..., 2). Here and below, `out` is an array to write them to, and is returned."""
        at = places(xz, 2, "places")
        out = room(out, at.shape[:-1])
        asked, heights = doubles(at), ffi.from_buffer("float[]", out)
        self._call(out.size, lambda first, n: lib.rc_terrain_heights(self._terrain, asked + 2 * first, n, heights + first))
        return out

    def height(self, x: float, z: float) -> float:
        """The height at one place, metres."""
        return float(self.heights((x, z)))

    def patches(self, bodies: ArrayLike, offsets: ArrayLike, out: Optional[NDArray[np.float32]] = None) -> NDArray[np.float32]:
        """Heights around bodies (..., 3): x, z, yaw, at offsets (k..., 2) to their right and behind them, metres: float32 (..., k...)."""
        at, around = places(bodies, 3, "bodies"), places(offsets, 2, "offsets")
        out = room(out, at.shape[:-1] + around.shape[:-1])
        each = out.size // max(1, at.size // 3)
        asked, offset, heights = doubles(at), doubles(around), ffi.from_buffer("float[]", out)
        self._call(at.size // 3, lambda first, n: lib.rc_terrain_patches(
            self._terrain, asked + 3 * first, n, offset, each, heights + each * first))
        return out

    def normals(self, xz: ArrayLike, spacing: float = 1 / 16, out: Optional[NDArray[np.float32]] = None) -> NDArray[np.float32]:
        """Unit normals, float32 (..., 3), at places (..., 2), of the planes through the heights `spacing` metres to each side."""
        at = places(xz, 2, "places")
        out = room(out, at.shape[:-1] + (3,))
        asked, normals = doubles(at), ffi.from_buffer("float[]", out)
        self._call(out.size // 3,
                   lambda first, n: lib.rc_terrain_normals(self._terrain, asked + 2 * first, n, spacing, normals + 3 * first))
        return out

    def materials(self, at: ArrayLike) -> NDArray[np.uint8]:
        """What the ground is made of at places (..., 2), or points (..., 3) such as the `at` of Hits: numbers (...), which `material_names`
        names. 0: it is not said, or the point is nan."""
        points = real(at, "places")
        if points.ndim == 0 or points.shape[-1] not in (2, 3):
            raise Invalid(f"places are an array of shape (..., 2), and points of (..., 3), not {points.shape}")
        there = np.ones(points.shape[:-1], bool)
        if points.shape[-1] == 3:
            there = ~np.isnan(points).any(axis=-1)
            points = np.where(there[..., None], points[..., ::2], 0)
        xz = np.ascontiguousarray(points)
        out = np.empty(there.shape, np.uint8)
        asked, materials = doubles(xz), ffi.from_buffer("uint8_t[]", out)
        self._call(out.size, lambda first, n: lib.rc_terrain_materials(self._terrain, asked + 2 * first, n, materials + first))
        return np.where(there, out, np.uint8(0))

    @property
    def material_names(self) -> Tuple[str, ...]:
        """The names of materials, by their numbers; "": it is not said. The terrain's own, such as "water", follow those that edits paint."""
        names = [""]
        while len(names) < 256 and (name := lib.rc_terrain_material(self._terrain, len(names))) != ffi.NULL:
            names.append(ffi.string(name).decode())
        return tuple(names)

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

    @property
    def known(self) -> str:
        """Which of these holds for the rays of this terrain: "proven", "measured" or "sampled"."""
        return str(ffi.string(lib.rc_terrain_known(self._terrain)).decode())

    def scan(self, at: ArrayLike, pattern: ArrayLike, turn: ArrayLike = (0, 0, 0, 1), *, reach: float = 100.0, noise: float = 0.0,
             dropouts: float = 0.0, seed: int = 0) -> Scan:
        """What sensors at points (..., 3) measure whose beams are the pattern (k..., 3): `rc.lidar(64)`, `rc.rosette()`, `rc.pinhole(...)`, or
        directions of your own in the sensor's frame.

        turn: a quaternion x, y, z, w of all sensors or each (..., 4), such as `rc.quaternion(yaw, pitch, roll)`; they look to the north else.
        noise: the standard deviation of distances, metres; dropouts: how many of a ray's echoes are lost, 0 to 1. Both are the same for the
        same seed.
        """
        if not (noise >= 0 and 0 <= dropouts <= 1):
            raise Invalid("noise is 0 or more, and dropouts are 0 to 1")
        sensors = places(at, 3, "points")
        try:
            beams = turned(pattern, np.broadcast_to(real(turn, "turns"), sensors.shape[:-1] + (4,)))
        except ValueError:
            raise Invalid(f"a turn is one quaternion, (4,), or one for each of the points, {sensors.shape[:-1] + (4,)}") from None
        hits = self.rays(sensors.reshape(sensors.shape[:-1] + (1,) * (beams.ndim - sensors.ndim) + (3,)), beams, reach)
        random = np.random.default_rng(seed)
        back = np.isfinite(hits.distance)
        if dropouts:
            back &= random.random(back.shape) >= dropouts
        shift = np.where(back, random.normal(0, noise, back.shape) if noise else 0, np.nan)
        return Scan(np.where(back, np.maximum(hits.distance + np.nan_to_num(shift), 0), np.inf).astype(np.float32),
                    hits.at + beams * shift[..., None],
                    np.where(back[..., None], hits.normal, np.nan).astype(np.float32))

    def sees(self, a: ArrayLike, b: ArrayLike) -> NDArray[np.bool_]:
        """Whether no ground lies between points a and b, (..., 3), at most 1e5 m apart: bool (...). The last centimetre does not count."""
        begin, end = np.broadcast_arrays(places(a, 3, "points"), places(b, 3, "points"))
        towards = end - begin
        reach = np.linalg.norm(towards, axis=-1)
        towards[reach == 0] = (0, 1, 0)
        return np.asarray(np.isinf(self.rays(begin, towards, np.maximum(reach - 0.01, 0)).distance))

    def grid(self, center: Tuple[float, float], size: Union[float, Tuple[float, float]], spacing: float) -> Grid:
        """Heights around a center (x, z), `spacing` metres apart, to be saved for a simulator. size: east to west and north to south, metres;
        of a square one number; rounded up to whole squares."""
        across, along = (float(s) for s in (size if isinstance(size, tuple) else (size, size)))
        if not (spacing > 0 and across > 0 and along > 0 and across / spacing * (along / spacing) <= 1e8):
            raise Invalid("a spacing and a size are above 0, and a grid has at most 100,000,000 squares")
        x, z = (c + spacing * (np.arange(n + 1) - n / 2)
                for c, n in zip(center, (math.ceil(across / spacing), math.ceil(along / spacing))))
        return Grid(self.heights(np.stack(np.meshgrid(x, z), axis=-1)), float(spacing), (float(center[0]), float(center[1])))

    def standing(self, spacing: float = 1.0, radius: Optional[float] = None, memory: int = 50_000_000) -> Standing:
        """Ground under bodies: heights `spacing` metres apart (a multiple of 1/64), `radius` metres around each (default: 32 times the
        spacing), in at most `memory` bytes."""
        made = Standing(self._terrain, spacing, 32 * spacing if radius is None else radius, memory)
        self._stand(made)
        return made

    def _stand(self, ground: Standing) -> None:
        """It was made."""


class Terrain(Questions):
    """A terrain, without a server. Long calls take all cores.

    name: "alpine", "canyon", "archipelago"; a terrain file (.glsl; needs a C++ compiler, and seconds the first time); or a height map
    (.tif, .png, .asc, .hgt, .r16, .raw)
    parameters: values for parameters of a built-in terrain or a terrain file
    raster: options of a height map, such as "pitch=30 nodata=fill"
    classes: a file of whole numbers that say what a height map's ground is made of, such as land cover; `raster` names them,
    "class=10:forest class=30:grass"
    """

    def __init__(self, name: "Union[str, PathLike[str]]" = "alpine", seed: int = 1, parameters: Optional[Mapping[str, float]] = None,
                 raster: str = "", classes: "Union[str, PathLike[str], None]" = None) -> None:
        if not 1 <= seed < 1 << 32:
            raise Invalid("a seed is 1 to 4294967295")
        kept = [(text(key), float(value)) for key, value in (parameters or {}).items()]
        raster_text, server, classes_text = text(raster), text(program(required=False)), text(classes)
        options = struct("rc_terrain_options", seed=seed, parameter_count=len(kept), raster=raster_text, program=server,
                         classes=classes_text)
        values = ffi.new("rc_parameter[]", kept) if kept else ffi.NULL
        options.parameters = values
        out = ffi.new("rc_terrain**")
        spelt = text(name)
        interruptible(lambda: lib.rc_terrain_open(spelt, options, out), lambda: lib.rc_terrain_close(out[0]))
        self._terrain = owned(out[0], lib.rc_terrain_close)
        self._threads = len(os.sched_getaffinity(0))
        self.name = str(name)
        self.seed = seed
        self.parameters = dict(parameters or {})
        self.raster = raster
        self.classes = classes

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
        return Terrain, (self.name, self.seed, self.parameters, self.raster, self.classes)

    def __copy__(self) -> "Terrain":  # it never changes
        return self

    def __deepcopy__(self, memo: object) -> "Terrain":
        return self
