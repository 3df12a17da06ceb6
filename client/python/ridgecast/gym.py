"""Many drones over endless terrain as one vectorised environment of Gymnasium, which need not be installed."""

from typing import Any, Dict, NamedTuple, Optional, Tuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._errors import Invalid
from .scan import lidar
from .terrain import Terrain


class _Box(NamedTuple):
    """What Gymnasium's Box says."""

    low: float
    high: float
    shape: Tuple[int, ...]
    dtype: Any


_Space: Any = _Box
_Environment: Any = object
_ENDS: Any = "SameStep"
try:
    from gymnasium import spaces, vector

    _Space, _Environment, _ENDS = spaces.Box, vector.VectorEnv, vector.AutoresetMode.SAME_STEP
except ImportError:
    pass


class Drones(_Environment):  # type: ignore[misc]
    """Each flies to a goal 200 m away by thrust; it sees 5 x 5 heights below it, 4 m apart, and what level rays all round it meet.

    action: (n, 3), -1 to 1, times 10 m/s^2, beyond what carries the drone
    observation: float32 (n, 31 + rays), metres and m/s: the drone's heights above the 25 places, its velocity, the way to its goal, and how
    far the ground is along each ray, the first to the north and the others clockwise, at most 50
    An episode ends in the ground or within 5 m of the goal (terminated), or after 60 s (truncated); then the next one begins in the same
    step, and info["final_obs"] holds the last observations of the old ones, in the rows of info["_final_obs"].
    """

    STEP, LIMIT, REACH = 0.05, 1200, 50.0

    def __init__(self, terrain: Terrain, num_envs: int = 1000, rays: int = 16, extent: float = 1e6) -> None:
        if num_envs < 1 or rays < 0 or not 0 < extent <= 1e12:
            raise Invalid("there are 1 drone or more, with 0 rays or more, within 1e12 m")
        self.terrain, self.num_envs, self.extent = terrain, num_envs, extent
        self.metadata = {"autoreset_mode": _ENDS}
        self.single_action_space = _Space(-1.0, 1.0, (3,), np.float32)
        self.single_observation_space = _Space(-np.inf, np.inf, (31 + rays,), np.float32)
        self.action_space = _Space(-1.0, 1.0, (num_envs, 3), np.float32)
        self.observation_space = _Space(-np.inf, np.inf, (num_envs, 31 + rays), np.float32)
        across = np.arange(-8.0, 9.0, 4.0)
        self._grid = np.stack(np.meshgrid(across, across), axis=-1).reshape(25, 2)
        self._beams = lidar([0.0], rays)[0] if rays else np.empty((0, 3))
        self._at, self._velocity, self._goal = (np.zeros((num_envs, 3)) for _ in range(3))
        self._steps = np.zeros(num_envs, int)
        self._random = np.random.default_rng()

    def reset(self, *, seed: Optional[int] = None, options: Optional[Dict[str, Any]] = None) -> Tuple[NDArray[np.float32], Dict[str, Any]]:
        if seed is not None:
            self._random = np.random.default_rng(seed)
        self._begin(np.ones(self.num_envs, bool))
        return self._observe(), {}

    def step(self, actions: ArrayLike) -> Tuple[NDArray[np.float32], NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], Dict[str, Any]]:
        before = np.linalg.norm(self._goal - self._at, axis=1)
        self._velocity += (10 * np.clip(actions, -1, 1) - 0.3 * self._velocity) * self.STEP
        self._at += self._velocity * self.STEP
        self._steps += 1
        seen = self._observe()
        left = np.linalg.norm(self._goal - self._at, axis=1)
        crashed = seen[:, 12] <= 0
        arrived = (left < 5) & ~crashed
        terminated, truncated = crashed | arrived, self._steps >= self.LIMIT
        reward = before - left - 100 * crashed + 100 * arrived
        over = terminated | truncated
        info: Dict[str, Any] = {}
        if over.any():
            info = {"final_obs": seen.copy(), "_final_obs": over}
            self._begin(over)
            seen[over] = self._observe(over)
        return seen, reward, terminated, truncated, info

    def _begin(self, which: NDArray[np.bool_]) -> None:
        count = int(which.sum())
        at, angle = self._random.uniform(-self.extent, self.extent, (count, 2)), self._random.uniform(0, 2 * np.pi, count)
        goal = at + 200 * np.column_stack([np.cos(angle), np.sin(angle)])
        for state, xz in ((self._at, at), (self._goal, goal)):
            state[which] = np.column_stack([xz[:, 0], self.terrain.heights(xz) + 30, xz[:, 1]])
        self._velocity[which] = 0
        self._steps[which] = 0

    def _observe(self, which: Any = slice(None)) -> NDArray[np.float32]:
        at = self._at[which]
        heights = self.terrain.heights(at[:, None, ::2] + self._grid)
        around = np.minimum(self.terrain.rays(at[:, None], self._beams, self.REACH).distance, self.REACH)
        seen = np.concatenate([at[:, 1:2] - heights, self._velocity[which], self._goal[which] - at, around], axis=1)
        out: NDArray[np.float32] = seen.astype(np.float32)
        return out
