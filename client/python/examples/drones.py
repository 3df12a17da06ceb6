"""1,000 drones over endless terrain as one vectorised environment of Gymnasium's shape, and how fast it steps:  drones.py [STEPS]"""

import sys
import time
from typing import Any, Dict, Optional, Tuple

import numpy as np
from numpy.typing import NDArray

import ridgecast as rc

Floats = NDArray[np.float64]


class Drones:
    """Each flies to a goal 200 m away by thrust, and sees 5 x 5 heights below it, 4 m apart.

    action: (n, 3), -1 to 1, times 10 m/s^2, beyond what carries the drone
    observation: (n, 31), metres and m/s: the drone's heights above the 25 places, its velocity, the way to its goal
    An episode ends in the ground or within 5 m of the goal (terminated), or after 60 s (truncated); then the next one begins in the same
    step, and info["final_obs"] holds the last observations of the old ones, in the rows of info["_final_obs"].
    """

    STEP, LIMIT = 0.05, 1200

    def __init__(self, terrain: rc.Terrain, count: int = 1000, extent: float = 1e6) -> None:
        self.terrain, self.num_envs, self.extent = terrain, count, extent
        across = np.arange(-8.0, 9.0, 4.0)
        self._grid = np.stack(np.meshgrid(across, across), axis=-1).reshape(25, 2)
        self._at, self._velocity, self._goal = (np.zeros((count, 3)) for _ in range(3))
        self._steps = np.zeros(count, int)
        self._random = np.random.default_rng()

    def reset(self, *, seed: Optional[int] = None, options: Optional[Dict[str, Any]] = None) -> Tuple[Floats, Dict[str, Any]]:
        if seed is not None:
            self._random = np.random.default_rng(seed)
        self._begin(np.ones(self.num_envs, bool))
        return self._observe(), {}

    def step(self, action: Floats) -> Tuple[Floats, Floats, NDArray[np.bool_], NDArray[np.bool_], Dict[str, Any]]:
        before = np.linalg.norm(self._goal - self._at, axis=1)
        self._velocity += (10 * np.clip(action, -1, 1) - 0.3 * self._velocity) * self.STEP
        self._at += self._velocity * self.STEP
        self._steps += 1
        seen = self._observe()
        left = np.linalg.norm(seen[:, 28:], axis=1)
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

    def _observe(self, which: Any = slice(None)) -> Floats:
        at = self._at[which]
        heights = self.terrain.heights(at[:, None, ::2] + self._grid)
        return np.concatenate([at[:, 1:2] - heights, self._velocity[which], self._goal[which] - at], axis=1)


def main() -> None:
    steps = int(sys.argv[1]) if len(sys.argv) > 1 else 1000
    drones = Drones(rc.Terrain("alpine"))
    seen, _ = drones.reset(seed=1)
    arrived = crashed = 0
    times = []
    for _ in range(steps):
        clearance = seen[:, :25].min(axis=1)
        wish = np.clip(seen[:, 28:] * (0.3, 0, 0.3), -10, 10)
        wish[:, 1] = np.clip(20 - clearance, -10, 10)
        begin = time.perf_counter()
        seen, reward, terminated, truncated, _ = drones.step(0.2 * (wish - seen[:, 25:28]))
        times.append(time.perf_counter() - begin)
        arrived += int((terminated & (reward > 0)).sum())
        crashed += int((terminated & (reward < 0)).sum())
    median, worst = np.median(times), np.max(times)
    print(f"{drones.num_envs} drones, {steps} steps: {arrived} arrived, {crashed} crashed")
    print(f"a step of all: {1e3 * median:.2f} ms (median), {1e3 * worst:.2f} ms (worst); "
          f"{1 / median:,.0f} steps/s of all, {drones.num_envs / median:,.0f} of one drone")


if __name__ == "__main__":
    main()
