"""Endless terrain for simulations: true heights anywhere, shared sessions, the ground as triangles.

    >>> import numpy as np, ridgecast as rc
    >>> alpine = rc.Terrain("alpine", seed=7)
    >>> alpine.heights(np.array([[10.0, 20.0], [11.0, 20.0]])).shape
    (2,)

Metres everywhere, float64 in; +Y is up, x and z lie on the horizontal plane. Places are arrays of shape (..., 2): x, z. Points are of
shape (..., 3): x, y, z. Places are rounded to 2^-8 m, and a float64 holds each of them exactly, out to 4.398e12 m. Angles are in radians,
times in seconds. Heights have the same bits on every machine, whether computed here or by a server.

Calls release the GIL, and Ctrl-C interrupts those that wait. Terrains and meshes may be used by any thread; calls on one world take turns.
"""

from ._errors import Error, Invalid, Lost, Refused, Timeout
from ._library import version as __version__
from .frames import enu, from_ros, quaternion, ros, xyz
from .glb import read_glb
from .grid import Grid
from .mesh import Mesh
from .scan import BEAMS, Scan, lidar, pinhole, rosette
from .server import Server, server
from .standing import Standing, Tile
from .terrain import Hits, Terrain
from .world import Cell, Clock, Iteration, Leaf, Member, World, join

__all__ = [
    "BEAMS", "Cell", "Clock", "Error", "Grid", "Hits", "Invalid", "Iteration", "Leaf", "Lost", "Member", "Mesh", "Refused", "Scan",
    "Server", "Standing", "Terrain", "Tile", "Timeout", "World", "enu", "from_ros", "join", "lidar", "pinhole", "quaternion",
    "read_glb", "ros", "rosette", "server", "xyz",
]
