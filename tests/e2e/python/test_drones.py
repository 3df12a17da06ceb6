"""The environment of ridgecast.gym, against what is worked out by hand."""

import unittest

import numpy as np

import ridgecast as rc
from ridgecast.gym import Drones

ALPINE = rc.Terrain("alpine", seed=3)


class DronesTest(unittest.TestCase):
    def test_a_seed_repeats_and_another_does_not(self) -> None:
        def fly(seed: int) -> np.ndarray:
            drones, random = Drones(ALPINE, 20), np.random.default_rng(7)
            seen = [drones.reset(seed=seed)[0]]
            seen += [drones.step(random.uniform(-1, 1, (20, 3)))[0] for _ in range(200)]
            return np.stack(seen)

        np.testing.assert_array_equal(fly(1), fly(1))
        self.assertTrue((fly(1) != fly(2)).any())

    def test_one_that_falls_ends_in_the_ground_and_begins_again(self) -> None:
        drones = Drones(ALPINE, 50)
        seen, _ = drones.reset(seed=5)
        height, speed, steps = 30.0, 0.0, 0
        np.testing.assert_allclose(seen[:, 12], height, atol=1e-3)
        while height > 0:  # all alike, straight down
            speed += (-10 - 0.3 * speed) * 0.05
            height += speed * 0.05
            steps += 1
            seen, reward, terminated, truncated, info = drones.step(np.tile([0.0, -1.0, 0.0], (50, 1)))
            self.assertEqual(terminated.all(), height <= 0)
            self.assertEqual(terminated.any(), height <= 0)
        self.assertGreater(steps, 20)
        self.assertTrue((reward < -90).all() and not truncated.any() and info["_final_obs"].all())
        np.testing.assert_allclose(info["final_obs"][:, 12], height, atol=1e-3)
        np.testing.assert_allclose(seen[:, 12], 30, atol=1e-3)
        np.testing.assert_array_equal(seen[:, 25:28], 0)

    def test_one_that_hovers_is_cut_off_after_a_minute(self) -> None:
        drones = Drones(ALPINE, 3)
        drones.reset(seed=1)
        for step in range(1, 1201):
            _, _, terminated, truncated, _ = drones.step(np.zeros((3, 3)))
            self.assertFalse(terminated.any())
            self.assertEqual(truncated.all(), step == 1200)

    def test_heights_are_those_of_the_true_ground_around(self) -> None:
        drones = Drones(ALPINE, 4)
        seen, _ = drones.reset(seed=2)
        for drone in range(4):
            x, y, z = drones._at[drone]
            expected = [y - ALPINE.height(x + dx, z + dz) for dz in (-8, -4, 0, 4, 8) for dx in (-8, -4, 0, 4, 8)]
            np.testing.assert_allclose(seen[drone, :25], expected, rtol=0, atol=1e-4)

    def test_rays_are_those_of_the_true_ground_around(self) -> None:
        drones = Drones(ALPINE, 40, rays=8, extent=5000)
        seen, _ = drones.reset(seed=3)
        drones._at[:, 1] -= 28  # 2 m above the ground
        seen = drones.step(np.zeros((40, 3)))[0]
        self.assertTrue((seen[:, 31:] < 50).any() and (seen[:, 31:] == 50).any())
        for drone in range(40):
            for k, angle in enumerate(np.arange(8) * np.pi / 4):
                hit = ALPINE.rays(drones._at[drone], (np.sin(angle), 0, -np.cos(angle)), 50).distance
                np.testing.assert_allclose(seen[drone, 31 + k], min(hit, 50), atol=1e-3)
        self.assertEqual(seen.dtype, np.float32)
        self.assertEqual(seen.shape, drones.observation_space.shape)
        self.assertEqual(Drones(ALPINE, 2, rays=0).reset()[0].shape, (2, 31))
        self.assertRaises(rc.Invalid, Drones, ALPINE, 0)


if __name__ == "__main__":
    unittest.main(verbosity=2)
