"""Other frames than this package's, x, y up, z to the south: east, north, up, as ROS and most simulators have it. Nothing is mirrored.

A turn is a unit quaternion, (..., 4): x, y, z, w. It turns what is given in a body's frame (x right, y up, z back) into the world's.
"""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._errors import Invalid
from ._library import places, real

_HALF = np.sqrt(0.5)
_WORLD = np.array([_HALF, 0, 0, _HALF])  # x, y, z -> x, -z, y
_BODY = np.array([0.5, -0.5, -0.5, 0.5])  # right, up, back -> ahead, left, up


def enu(points: ArrayLike) -> NDArray[np.float64]:
    """East, north, up of points or directions x, y, z: both (..., 3)."""
    x, y, z = np.moveaxis(places(points, 3, "points"), -1, 0)
    return np.stack([x, -z, y], axis=-1)


def xyz(points: ArrayLike) -> NDArray[np.float64]:
    """x, y, z of points or directions east, north, up: both (..., 3)."""
    east, north, up = np.moveaxis(places(points, 3, "points"), -1, 0)
    return np.stack([east, up, -north], axis=-1)


def quaternion(yaw: ArrayLike = 0.0, pitch: ArrayLike = 0.0, roll: ArrayLike = 0.0) -> NDArray[np.float64]:
    """The turn, (..., 4), of a body that looks where a camera with this yaw (to the left) and pitch (up) looks, and rolls to the right."""
    try:
        angles = np.broadcast_arrays(*(real(a, "angles") / 2 for a in (yaw, pitch, roll)))
    except ValueError:
        raise Invalid("yaw, pitch and roll are one number each, or of one shape") from None
    (sy, cy), (sp, cp), (sr, cr) = ((np.sin(a), np.cos(a)) for a in angles)
    none = np.zeros_like(sy)
    return _product(_product(np.stack([none, sy, none, cy], axis=-1), np.stack([sp, none, none, cp], axis=-1)),
                    np.stack([none, none, -sr, cr], axis=-1))


def ros(turn: ArrayLike) -> NDArray[np.float64]:
    """A turn as ROS has it: of a body whose x is ahead, y left, z up, in east, north, up."""
    return _product(_product(_WORLD, places(turn, 4, "turns")), _conjugate(_BODY))


def from_ros(turn: ArrayLike) -> NDArray[np.float64]:
    return _product(_product(_conjugate(_WORLD), places(turn, 4, "turns")), _BODY)


def matrices(turn: ArrayLike) -> NDArray[np.float64]:
    """(..., 3, 3), which turn columns."""
    given = places(turn, 4, "turns")
    length = np.linalg.norm(given, axis=-1, keepdims=True)
    if not np.all(np.isfinite(length) & (length > 0)):
        raise Invalid("a turn is a quaternion x, y, z, w whose length is not 0")
    x, y, z, w = np.moveaxis(given / length, -1, 0)
    rows = (1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w),
            2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w),
            2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y))
    out: NDArray[np.float64] = np.stack(rows, axis=-1).reshape(x.shape + (3, 3))
    return out


def _conjugate(q: NDArray[np.float64]) -> NDArray[np.float64]:
    out: NDArray[np.float64] = q * (-1, -1, -1, 1)
    return out


def _product(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    u, v = a[..., :3], b[..., :3]
    s, t = a[..., 3:], b[..., 3:]
    vector: Any = s * v + t * u + np.cross(u, v)
    return np.concatenate([vector, s * t - np.sum(u * v, axis=-1, keepdims=True)], axis=-1)
