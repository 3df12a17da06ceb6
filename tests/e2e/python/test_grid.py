"""Ground in the files of simulators: read again by MuJoCo and SDFormat where they are installed."""

import ctypes
import ctypes.util
import re
import tempfile
import unittest
from pathlib import Path
from typing import Any

import numpy as np

import ridgecast as rc

ALPINE = rc.Terrain("alpine", seed=7)
AT = (-2570.0, -1550.0)


def library(name: str) -> Any:
    found = ctypes.util.find_library(name)
    return found and ctypes.CDLL(found)


class GridTest(unittest.TestCase):
    def setUp(self) -> None:
        scratch = tempfile.TemporaryDirectory()
        self.addCleanup(scratch.cleanup)
        self.folder = Path(scratch.name)
        self.grid = ALPINE.grid(AT, (60, 40), 0.5)
        random = np.random.default_rng(1)
        self.east_north = random.uniform((-29, -19), (29, 19), (300, 2))
        self.heights = ALPINE.heights(AT + self.east_north * (1, -1))

    def expect_ground(self, heights: Any) -> None:  # a square is flat to some centimetres
        off = np.abs(np.asarray(heights) - self.heights)
        self.assertLess(off.max(), 0.1)
        self.assertLess(np.median(off), 0.01)

    def test_a_grid_is_the_true_ground(self) -> None:
        self.assertEqual((self.grid.heights.shape, self.grid.heights.dtype), ((81, 121), np.float32))
        self.assertEqual(self.grid.heights[0, 0], ALPINE.height(AT[0] - 30, AT[1] - 20))
        self.assertEqual(self.grid.heights[80, 120], ALPINE.height(AT[0] + 30, AT[1] + 20))
        self.assertEqual(ALPINE.grid((0, 0), 10, 3).heights.shape, (5, 5))
        for size, spacing in ((0, 1), (10, 0), (10, float("nan")), (1e6, 1)):
            self.assertRaises(rc.Invalid, ALPINE.grid, AT, size, spacing)
        self.assertRaisesRegex(rc.Invalid, "ends with", self.grid.save, self.folder / "ground.png")

    def test_an_array_lies_north_above_south_reversed(self) -> None:
        self.grid.save(self.folder / "ground.npz")
        file = np.load(self.folder / "ground.npz")
        np.testing.assert_array_equal(file["heights"], self.grid.heights[::-1])
        self.assertEqual((float(file["spacing"]), tuple(file["center"])), (0.5, AT))

    def test_mujoco_stands_on_it(self) -> None:
        mujoco = library("mujoco")
        if not mujoco:
            self.skipTest("MuJoCo is not installed: ./run install physics")
        self.grid.save(self.folder / "ground.xml")
        for function, kind in (("mj_loadXML", ctypes.c_void_p), ("mj_makeData", ctypes.c_void_p), ("mj_ray", ctypes.c_double)):
            getattr(mujoco, function).restype = kind
        why = ctypes.create_string_buffer(1000)
        model = ctypes.c_void_p(mujoco.mj_loadXML(str(self.folder / "ground.xml").encode(), None, why, 1000))
        self.assertTrue(model, why.value)
        data = ctypes.c_void_p(mujoco.mj_makeData(model))
        mujoco.mj_forward(model, data)

        def down(east: float, north: float) -> float:
            top, hit = 2000.0, ctypes.c_int()
            point, way = (ctypes.c_double * 3)(east, north, top), (ctypes.c_double * 3)(0, 0, -1)
            return top - float(mujoco.mj_ray(model, data, point, way, None, 1, -1, ctypes.byref(hit)))

        self.expect_ground([down(*at) for at in self.east_north])

    def test_sdformat_takes_it(self) -> None:
        sdformat = library("sdformat12")
        if not sdformat:
            self.skipTest("SDFormat is not installed: ./run install physics")
        self.grid.save(self.folder / "a & b.sdf")
        self.assertEqual(sdformat.cmdCheck(str(self.folder / "a & b.sdf").encode()), 0)
        self.assertTrue((self.folder / "a & b.obj").exists())

    def test_triangles_are_the_ground_seen_from_above(self) -> None:
        self.grid.save(self.folder / "ground.obj")
        rows = [line.split() for line in (self.folder / "ground.obj").read_text().splitlines()]
        points = np.array([r[1:] for r in rows if r[0] == "v"], float)
        faces = np.array([r[1:] for r in rows if r[0] == "f"], int) - 1
        self.expect_triangles(points, faces)
        self.grid.save(self.folder / "ground.usda")
        text = (self.folder / "ground.usda").read_text()
        numbers = {name: np.array(re.findall(r"-?[\d.]+(?:e-?\d+)?", text[text.index(name + " = ["):].split("\n")[0]), float)
                   for name in ("faceVertexIndices", "points", "faceVertexCounts")}
        np.testing.assert_array_equal(numbers["faceVertexIndices"].reshape(-1, 3), faces)
        np.testing.assert_array_equal(numbers["points"].reshape(-1, 3), points)
        np.testing.assert_array_equal(numbers["faceVertexCounts"], [3] * len(faces))

    def expect_triangles(self, points: Any, faces: Any) -> None:
        self.assertEqual((points.shape, faces.shape), ((81 * 121, 3), (2 * 80 * 120, 3)))
        a, b, c = (points[faces[:, k]] for k in range(3))
        normals = np.cross(b - a, c - a)
        self.assertTrue((normals[:, 2] > 0).all())
        self.assertAlmostEqual(normals[:, 2].sum() / 2, 60 * 40, places=3)
        np.testing.assert_allclose(points[:, 2], ALPINE.heights(AT + points[:, :2] * (1, -1)), atol=1e-3)

    def test_triangles_of_a_server_are_saved_alike(self) -> None:
        with rc.server("alpine", seed=7, quiet=True) as server, rc.join(server.url) as world:
            self.assertEqual(world.grid(AT, 4, 0.5).heights.tolist(), ALPINE.grid(AT, 4, 0.5).heights.tolist())
            mesh = world.ground(AT, 30, 0.2)
        mesh.save(self.folder / "mesh.obj")
        rows = [line.split() for line in (self.folder / "mesh.obj").read_text().splitlines()]
        points = np.array([r[1:] for r in rows if r[0] == "v"], float)
        self.assertEqual(len(rows), len(mesh.positions) + len(mesh.triangles))
        near = np.hypot(points[:, 0], points[:, 1]) < 30
        np.testing.assert_allclose(points[near, 2], ALPINE.heights(AT + points[near, :2] * (1, -1)), atol=0.21)
        self.assertRaises(rc.Invalid, mesh.save, self.folder / "mesh.xml")


if __name__ == "__main__":
    unittest.main(verbosity=2)
