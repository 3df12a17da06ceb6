"""Three processes in one session, two in Python and one in C++, in lock-step: each computes the same heights, and the same ground around a
moving body, in each step.  test_members.py C++_MEMBER; STEPS=1000 for the whole of it."""

import os
import subprocess
import sys
import zlib

import numpy as np

import ridgecast as rc

STEPS = int(os.environ.get("STEPS", "60"))
STEP = 0.02


def compute(world: rc.World, time: float) -> str:
    """What member.cpp computes."""
    ticks = round(time / STEP)
    x, z = ticks * 82, ticks % 50 * 17
    heights = world.heights(np.array([[x, z], [x + 256, z], [x - 256, z], [x, z + 300]]) / 256)
    ground = world.ground((x / 256, z / 256), 16, 0.25, timeout=120)
    sum = zlib.crc32(ground.triangles.tobytes(), zlib.crc32(ground.positions.tobytes(), zlib.crc32(heights.tobytes())))
    return f"{round(time * 1e6)} {sum:08x}\n"


def follow(url: str) -> None:
    with rc.join(url, name="Python", sensor=True, follow=True) as world:
        print("follows", flush=True)
        for _ in range(STEPS):
            print(compute(world, world.clock.next(timeout=120)), end="", flush=True)
        try:
            world.clock.next(timeout=1)  # says that the last is done
        except rc.Timeout:
            pass


def main() -> None:
    with rc.server("canyon", seed=8) as server:
        url = server.url + "?session=race&terrain=alpine&seed=3"
        with rc.join(url, name="owner", sensor=True) as owner:
            owner.clock.set("stepped")
            members = [subprocess.Popen([sys.argv[1], url, str(STEPS)], stdout=subprocess.PIPE, text=True),
                       subprocess.Popen([sys.executable, __file__, "follow", url], stdout=subprocess.PIPE, text=True)]
            assert all(m.stdout and m.stdout.readline() == "follows\n" for m in members)
            rest = -owner.clock.time % STEP  # to a whole number of steps
            if rest > 1e-6:
                owner.clock.step(rest + STEP, timeout=120)
                first = 1
            else:
                first = 0
            computed = [compute(owner, owner.clock.time)] if first else []
            for _ in range(STEPS - first):
                owner.clock.step(STEP, timeout=120)
                computed.append(compute(owner, owner.clock.time))
            for member in members:
                said = member.stdout.readlines() if member.stdout else []
                assert member.wait(60) == 0
                assert said == computed, [(a, b) for a, b in zip(said, computed) if a != b][:3] or (len(said), len(computed))
    assert len(set(line.split()[1] for line in computed)) > STEPS / 2, "the body moves"
    print(f"{STEPS} steps, {1 + len(members)} members: the same")


if sys.argv[1] == "follow":
    follow(sys.argv[2])
else:
    main()
