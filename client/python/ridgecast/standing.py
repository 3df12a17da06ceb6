"""Ground under bodies that move."""

import threading
from dataclasses import dataclass
from typing import Any, Dict, List, Tuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._errors import Invalid
from ._library import check, doubles, ffi, in_slices, lib, owned, places, struct, usable


@dataclass(frozen=True)
class Tile:
    """A square of ground; neighbours share their border's heights."""

    i: int  #: its corner of least x and z is at (i, j) times its side, which is 32 * spacing
    j: int
    version: int  #: grows with each tile that is made
    x: float  #: of that corner, metres
    z: float
    spacing: float  #: metres
    error: float  #: metres: how far the true ground is above or below its squares at most, split along either diagonal (measured)
    heights: NDArray[np.float32]  #: (33, 33), metres; rows of ascending z, each of ascending x
    edit: int = 0  #: the last edit that its heights know; later ones have changed other ground


class Standing:
    """Tiles of heights that follow bodies; made by `standing` of a terrain or world. A context manager. Threads that call it take turns.

    A background thread makes the ground ahead of the bodies, the nearest first, so that no step waits.
    That is slow where it has to ask a server for heights: keep the spacing wide and the radius small.
    """

    def __init__(self, owner: Any, spacing: float, radius: float, memory: int) -> None:
        if not spacing > 0 or not radius >= 0 or memory < 1:
            raise Invalid("a spacing and a memory are above 0, and a radius is not below it")
        out = ffi.new("rc_standing**")
        check(lib.rc_standing_open(owner, struct("rc_standing_options", spacing=spacing, radius=max(radius, 1 / 256), memory=memory), out))

        def close(standing: Any, owner: Any = owner) -> None:  # which lives longer
            lib.rc_standing_close(standing)

        self._handle = owned(out[0], close)
        self._lock = threading.Lock()
        self.tiles: Dict[Tuple[int, int], Tile] = {}  #: by (i, j), as of the last `changes`

    def close(self) -> None:
        """Stops making ground, as soon as no call is under way; a world that is closed does so, too. Tiles that were taken stay valid."""
        self._handle = ffi.NULL

    def __enter__(self) -> "Standing":
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    @property
    def _standing(self) -> Any:
        return usable(self._handle, "ground")

    def move(self, xz: ArrayLike) -> NDArray[np.bool_]:
        """Call once a step: where all bodies are, (n, 2), in the same order each time. Never waits for heights. Returns, (n,), whether the
        ground around each is there, with all edits that were told by then."""
        at = places(xz, 2, "places").reshape(-1, 2)
        ready = np.empty(len(at), np.bool_)
        with self._lock:
            check(lib.rc_standing_move(self._standing, doubles(at), len(at)))
            check(lib.rc_standing_ready(self._standing, len(at), ffi.from_buffer("uint8_t[]", ready)))
        return ready

    def wait(self, timeout: float = 10.0) -> None:
        """Waits until the ground around all bodies is there, with all edits that this member has made or been told of: call it at the
        beginning, and after an edit, or moving a body elsewhere at once."""

        def wait(slice: float) -> None:
            with self._lock:
                check(lib.rc_standing_wait(self._standing, slice))

        in_slices(wait, timeout)

    def changes(self) -> Tuple[List[Tile], List[Tile]]:
        """The tiles that went and those that came since the last call. A tile whose ground an edit has changed is in both."""
        gone: List[Tile] = []
        came: List[Tile] = []
        count, room = ffi.new("size_t*"), 256
        out = ffi.new("rc_tile[]", room)
        out[0].size = ffi.sizeof("rc_tile")
        with self._lock:  # whose heights last until the next call
            while True:
                check(lib.rc_standing_changes(self._standing, out, room, count))
                for tile in (out[k] for k in range(min(room, count[0]))):
                    if tile.gone:
                        gone.append(self.tiles.pop((tile.i, tile.j)))
                        continue
                    heights = np.frombuffer(ffi.buffer(tile.heights, 33 * 33 * 4), np.float32).reshape(33, 33).copy()
                    heights.flags.writeable = False
                    came.append(Tile(tile.i, tile.j, tile.version, tile.x, tile.z, tile.spacing, tile.error, heights, tile.edit))
                    self.tiles[tile.i, tile.j] = came[-1]
                if count[0] <= room:
                    return gone, came
