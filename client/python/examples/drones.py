"""Flies 1,000 drones to their goals by a simple rule, and says how fast the environment steps:  drones.py [STEPS]"""

import sys
import time

import numpy as np

import ridgecast as rc
from ridgecast.gym import Drones


def main() -> None:
    steps = int(sys.argv[1]) if len(sys.argv) > 1 else 1000
    drones = Drones(rc.Terrain("alpine"))
    seen, _ = drones.reset(seed=1)
    arrived = crashed = 0
    times = []
    for _ in range(steps):
        clearance = seen[:, :25].min(axis=1)
        wish = np.clip(seen[:, 28:31] * (0.3, 0, 0.3), -10, 10)
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
