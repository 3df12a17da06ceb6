"""What sensors look at: directions of the beams of lidars and of the pixels of a depth camera.

All are unit vectors of shape (..., 3) in the sensor's own frame, x to its right, y up, z to its back: ahead is (0, 0, -1).
"""

from typing import Mapping, NamedTuple, Tuple, Union

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._errors import Invalid
from ._library import places, real
from .frames import matrices

#: Lowest and highest beam, degrees, of turning lidars with so many, evenly apart: as VLP-16, HDL-32E, HDL-64E and OS1-128 have them.
BEAMS: Mapping[int, Tuple[float, float]] = {16: (-15.0, 15.0), 32: (-30.67, 10.67), 64: (-24.8, 2.0), 128: (-22.5, 22.5)}


class Scan(NamedTuple):
    """What a sensor measures; (...) is the shape of its places, and then of its pattern."""

    distance: NDArray[np.float32]  #: (...), metres along the ray, with its noise; inf: nothing came back
    at: NDArray[np.float64]  #: (..., 3), there; nan: nothing came back
    normal: NDArray[np.float32]  #: (..., 3), of the ground there; nan: nothing came back


def lidar(beams: Union[int, ArrayLike] = 64, columns: int = 1024) -> NDArray[np.float64]:
    """One turn of a lidar, (beams, columns, 3): the lowest beam first; from ahead to the right and round.

    beams: 16, 32, 64 or 128 (BEAMS), or the elevation of each, in radians
    """
    if isinstance(beams, int):
        if beams not in BEAMS:
            raise Invalid(f"a lidar has {', '.join(map(str, BEAMS))} beams, or the elevation of each, not {beams}")
        elevations = np.radians(np.linspace(*BEAMS[beams], beams))
    else:
        elevations = np.atleast_1d(real(beams, "elevations"))
    if elevations.ndim != 1 or columns < 1:
        raise Invalid("a lidar has one elevation for each beam, and 1 column or more")
    up, round = np.broadcast_arrays(elevations[:, None], np.arange(columns) * (2 * np.pi / columns))
    return np.stack([np.cos(up) * np.sin(round), np.sin(up), -np.cos(up) * np.cos(round)], axis=-1)


def rosette(points: int = 10_000, field: float = np.radians(38.4), turns: float = 12.2, back: float = -7.8) -> NDArray[np.float64]:
    """A rosette, (points, 3), as two equal prisms draw it that turn so often meanwhile, one against the other; `field`: its width, radians."""
    along = np.linspace(0, 2 * np.pi, points, endpoint=False)
    x = field / 4 * (np.cos(turns * along) + np.cos(back * along))
    y = field / 4 * (np.sin(turns * along) + np.sin(back * along))
    off = np.hypot(x, y)
    out: NDArray[np.float64] = np.stack([np.sinc(off / np.pi) * x, np.sinc(off / np.pi) * y, -np.cos(off)], axis=-1)
    return out


def pinhole(width: int, height: int, vertical_fov: float) -> NDArray[np.float64]:
    """A camera's pixels, (height, width, 3), from the top left. Depth is a distance times the direction's -z."""
    if width < 1 or height < 1 or not 0 < vertical_fov < np.pi:
        raise Invalid("a picture has 1 pixel or more each way, and a field of view between 0 and pi")
    pixel = 2 * np.tan(vertical_fov / 2) / height
    x, y = np.meshgrid((np.arange(width) + 0.5 - width / 2) * pixel, (height / 2 - 0.5 - np.arange(height)) * pixel)
    towards = np.stack([x, y, np.full_like(x, -1)], axis=-1)
    out: NDArray[np.float64] = towards / np.linalg.norm(towards, axis=-1, keepdims=True)
    return out


def turned(pattern: ArrayLike, turn: ArrayLike) -> NDArray[np.float64]:
    """A pattern (k..., 3) as sensors look that are turned so (..., 4): (..., k..., 3)."""
    own = places(pattern, 3, "directions")
    turns = matrices(turn)
    out: NDArray[np.float64] = (own.reshape(-1, 3) @ np.swapaxes(turns, -1, -2)).reshape(turns.shape[:-2] + own.shape)
    return out
