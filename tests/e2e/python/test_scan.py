"""What sensors see of the true ground."""

import os
import signal
import threading
import time
import unittest

import numpy as np

import ridgecast as rc
from ridgecast.scan import turned


class ScanTest(unittest.TestCase):
    def setUp(self) -> None:
        self.canyon = rc.Terrain("canyon", seed=3)
        self.at = np.array([[0.0, 0, 0], [700, 0, -900]])
        self.at[:, 1] = self.canyon.heights(self.at[:, ::2]) + 2

    def test_patterns_look_where_they_say(self) -> None:
        for beams, (low, high) in rc.BEAMS.items():
            turn = rc.lidar(beams, 360)
            self.assertEqual(turn.shape, (beams, 360, 3))
            np.testing.assert_allclose(np.degrees(np.arcsin(turn[[0, -1], :, 1])), [[low] * 360, [high] * 360], atol=1e-9)
            np.testing.assert_allclose(turn[0, 90] / np.hypot(turn[0, 90, 0], turn[0, 90, 2]), (1, np.tan(np.radians(low)), 0), atol=1e-9)
        self.assertEqual(rc.lidar([0.0, 0.1, 0.2], 5).shape, (3, 5, 3))
        rose = rc.rosette(5000)
        self.assertAlmostEqual(np.degrees(np.arccos(-rose[:, 2].max())), 19.2, delta=0.1)
        picture = rc.pinhole(8, 6, 1.0)
        self.assertTrue(picture[0, 0, 0] < 0 < picture[0, 0, 1])
        for pattern in (rose, picture, rc.lidar(16, 3)):
            np.testing.assert_allclose(np.linalg.norm(pattern, axis=-1), 1, atol=1e-12)
        for wrong in (lambda: rc.lidar(7), lambda: rc.lidar(16, 0), lambda: rc.pinhole(0, 1, 1), lambda: rc.pinhole(1, 1, 4)):
            self.assertRaises(rc.Invalid, wrong)

    def test_sensors_turn_as_cameras_do(self) -> None:
        ahead, right, up = np.eye(3)[[2, 0, 1]] * [[-1], [1], [1]]
        quarter = np.pi / 2
        for yaw, pitch in np.random.default_rng(1).uniform(-1.5, 1.5, (20, 2)):  # PROTOCOL.md, Units
            forward = -np.sin(yaw) * np.cos(pitch), np.sin(pitch), -np.cos(yaw) * np.cos(pitch)
            np.testing.assert_allclose(turned(ahead, rc.quaternion(yaw, pitch, 0.7)), forward, atol=1e-12)
        np.testing.assert_allclose(turned(right, rc.quaternion(roll=quarter)), (0, -1, 0), atol=1e-12)
        np.testing.assert_allclose(turned(up, rc.quaternion(roll=quarter)), (1, 0, 0), atol=1e-12)
        self.assertEqual(turned(rc.lidar(16, 4), rc.quaternion(np.zeros((5, 2)))).shape, (5, 2, 16, 4, 3))

    def test_other_frames_are_turned_and_not_mirrored(self) -> None:
        random = np.random.default_rng(1)
        points = random.normal(size=(7, 3))
        np.testing.assert_array_equal(rc.enu([1, 2, 3]), [1, -3, 2])
        np.testing.assert_array_equal(rc.xyz(rc.enu(points)), points)
        self.assertAlmostEqual(np.linalg.det(rc.enu(np.eye(3))), 1)
        turns = rc.quaternion(*random.uniform(-3, 3, (3, 50)))
        np.testing.assert_allclose(rc.from_ros(rc.ros(turns)), turns, atol=1e-12)
        for yaw, east_north in ((0, (0, 1)), (np.pi / 2, (-1, 0)), (-np.pi / 2, (1, 0))):
            np.testing.assert_allclose(turned((1, 0, 0), rc.ros(rc.quaternion(yaw))), (*east_north, 0), atol=1e-12)
        ahead_left_up = np.array([(0, 0, -1), (-1, 0, 0), (0, 1, 0)])
        np.testing.assert_allclose(rc.enu(turned(ahead_left_up, turns)), turned(np.eye(3), rc.ros(turns)), atol=1e-12)
        for wrong in (lambda: rc.enu([1, 2]), lambda: rc.ros([0, 0, 1]), lambda: turned([0, 0, 1], [0, 0, 0, 0]),
                      lambda: turned([0, 0, 1], [0, 0, 0, np.nan]), lambda: rc.quaternion([0, 1], [0, 1, 2])):
            self.assertRaises(rc.Invalid, wrong)

    def test_a_scan_is_its_rays(self) -> None:
        turns = rc.quaternion([0.3, 2.0], [0.0, -0.1])
        scan = self.canyon.scan(self.at, rc.lidar(32, 64), turns, reach=300)
        self.assertEqual((scan.distance.shape, scan.distance.dtype), ((2, 32, 64), np.float32))
        self.assertEqual((scan.at.shape, scan.normal.shape), ((2, 32, 64, 3), (2, 32, 64, 3)))
        for k in range(2):
            one = self.canyon.rays(self.at[k], turned(rc.lidar(32, 64), turns[k]), 300)
            np.testing.assert_array_equal(scan.distance[k], one.distance.astype(np.float32))
            np.testing.assert_array_equal(scan.at[k], one.at)
        back = np.isfinite(scan.distance)
        self.assertGreater(back.mean(), 0.3)
        np.testing.assert_allclose(self.canyon.heights(scan.at[back][:, ::2]), scan.at[back][:, 1], atol=0.05)
        self.assertEqual(self.canyon.scan(self.at[0], rc.pinhole(4, 3, 1.0)).distance.shape, (3, 4))
        self.assertEqual(self.canyon.scan(np.zeros((0, 3)), rc.rosette(7)).distance.shape, (0, 7))
        self.assertRaises(rc.Invalid, self.canyon.scan, self.at, rc.rosette(7), np.zeros((3, 4)))
        self.assertRaises(rc.Invalid, self.canyon.scan, self.at, np.zeros((4, 2)))

    def test_noise_and_dropouts_repeat(self) -> None:
        def look(**options: float) -> rc.Scan:
            return self.canyon.scan(self.at, rc.lidar(64, 256), **options)

        clean, noisy = look(), look(noise=0.05, dropouts=0.25, seed=4)
        for a, b in zip(noisy, look(noise=0.05, dropouts=0.25, seed=4)):
            np.testing.assert_array_equal(a, b)
        self.assertFalse(np.array_equal(noisy.distance, look(noise=0.05, dropouts=0.25, seed=5).distance))
        there, back = np.isfinite(clean.distance), np.isfinite(noisy.distance)
        self.assertFalse(np.any(back & ~there))
        self.assertAlmostEqual(back[there].mean(), 0.75, delta=0.02)
        off = noisy.distance[back] - clean.distance[back]
        self.assertAlmostEqual(off.std(), 0.05, delta=0.003)
        np.testing.assert_allclose(np.linalg.norm(noisy.at - self.at[:, None, None], axis=-1)[back], noisy.distance[back], atol=0.02)
        self.assertTrue(np.all(np.isnan(noisy.at[~back])) and np.all(np.isnan(noisy.normal[~back])))
        for wrong in ({"noise": -1.0}, {"dropouts": 1.5}):
            self.assertRaises(rc.Invalid, look, **wrong)

    def test_sight_ends_at_the_ground(self) -> None:
        high = np.array([0.0, 5000, 0])
        ground = np.array([[300.0, 0, 400], [5000, 0, 0]])
        ground[:, 1] = self.canyon.heights(ground[:, ::2])
        self.assertEqual(self.canyon.sees(high, ground).tolist(), [True, True])
        self.assertEqual(self.canyon.sees(high, ground - (0, 1, 0)).tolist(), [False, False])
        self.assertTrue(self.canyon.sees(high, high))
        random = np.random.default_rng(1)
        a, b = (np.concatenate([p, self.canyon.heights(p)[:, None] + 3], axis=1)[:, [0, 2, 1]] for p in random.uniform(-2000, 2000, (2, 500, 2)))
        there, back = self.canyon.sees(a, b), self.canyon.sees(b, a)
        self.assertTrue(0 < there.mean() < 1)
        self.assertGreater((there == back).mean(), 0.99)

    def test_all_cores_give_the_same_and_end_with_ctrl_c(self) -> None:
        self.canyon._threads = 4
        pattern = rc.lidar(128, 1024)
        many = self.canyon.scan(self.at, pattern, reach=2000)
        self.canyon._threads = 1
        for a, b in zip(many, self.canyon.scan(self.at, pattern, reach=2000)):
            np.testing.assert_array_equal(a, b)
        self.canyon._threads = 4
        threading.Timer(0.1, os.kill, (os.getpid(), signal.SIGINT)).start()
        began = time.monotonic()
        with self.assertRaises(KeyboardInterrupt):
            for _ in range(100):
                self.canyon.scan(self.at, pattern, reach=1e5)
        self.assertLess(time.monotonic() - began, 3)
        with self.assertRaises(rc.Invalid):
            self.canyon.rays(np.concatenate([np.zeros((100_000, 3)) + (0, 900, 0), [[np.nan, 0, 0]]]), (0.1, -0.1, 1))


if __name__ == "__main__":
    unittest.main()
