"""The package as it is installed, against the wheel's own server."""

import contextlib
import copy
import json
import os
import pickle
import signal
import subprocess
import sys
import threading
import tempfile
import time
import unittest
import urllib.request
from pathlib import Path

import numpy as np

import ridgecast as rc


def places(count: int, seed: int = 3) -> np.ndarray:
    random = np.random.default_rng(seed)
    return random.uniform(-1, 1, (count, 2)) * 10 ** random.uniform(1, 12.6, (count, 1))


class TerrainTest(unittest.TestCase):
    def test_shapes_follow_the_places(self) -> None:
        alpine = rc.Terrain("alpine")
        for shape in ((), (0,), (1,), (7,), (3, 4), (2, 0, 5)):
            xz = np.zeros(shape + (2,))
            self.assertEqual(alpine.heights(xz).shape, shape)
            self.assertEqual(alpine.heights(xz).dtype, np.float32)
            self.assertEqual(alpine.normals(xz).shape, shape + (3,))
            hits = alpine.rays(np.zeros(shape + (3,)) + (0, 9000, 0), (0, -1, 0))
            self.assertEqual((hits.distance.shape, hits.at.shape, hits.normal.shape), (shape, shape + (3,), shape + (3,)))

    def test_places_of_any_layout_are_the_same(self) -> None:
        alpine, at = rc.Terrain("alpine", seed=9), np.round(places(1000) % 1e4)
        expected = alpine.heights(at)
        for other in (np.asfortranarray(at), at.astype(np.int64), at.astype(np.float32), at.tolist(), np.repeat(at, 2, axis=0)[::2],
                      at[::-1][::-1], at.astype(">f8")):
            np.testing.assert_array_equal(alpine.heights(other), expected)

    def test_a_place_is_rounded_to_its_step(self) -> None:
        alpine = rc.Terrain("alpine")
        at = places(2000)
        np.testing.assert_array_equal(alpine.heights(at), alpine.heights(np.floor(at * 256 + 0.5) / 256))

    def test_what_is_wrong_is_said(self) -> None:
        alpine = rc.Terrain("alpine")
        for bad in ([1.0, 2.0, 3.0], 5.0, [[1.0, np.nan]], [[1e13, 0.0]], [[np.inf, 0.0]]):
            with self.assertRaises(rc.Invalid):
                alpine.heights(bad)
        with self.assertRaisesRegex(rc.Refused, "canyon"):
            rc.Terrain("alpin")
        with self.assertRaises(rc.Refused):
            rc.Terrain("alpine", parameters={"nothing": 1})
        with self.assertRaises(ValueError):
            rc.Terrain("alpine", seed=0)
        with self.assertRaises(ValueError):
            alpine.rays([0, 0, 0], [0, 0, 0])
        with self.assertRaises((TypeError, ValueError)):
            alpine.heights("here")

    def test_rays_end_on_the_ground(self) -> None:
        canyon = rc.Terrain("canyon")
        random = np.random.default_rng(1)
        origins = np.column_stack([random.uniform(-5e3, 5e3, 300), np.full(300, 4000.0), random.uniform(-5e3, 5e3, 300)])
        directions = np.column_stack([random.normal(size=300), -np.ones(300), random.normal(size=300)])
        hits = canyon.rays(origins, directions)
        self.assertTrue(np.isfinite(hits.distance).all())
        unit = directions / np.linalg.norm(directions, axis=1, keepdims=True)
        np.testing.assert_allclose(hits.at, origins + unit * hits.distance[:, None], atol=1 / 256)
        np.testing.assert_allclose(canyon.heights(hits.at[:, [0, 2]]), hits.at[:, 1], atol=0.5)  # walls are steep
        self.assertEqual(canyon.rays([0, 4000, 0], [0, 1, 0]).distance, np.inf)
        self.assertEqual(canyon.known, "measured")

    def test_answers_go_where_the_caller_wants_them(self) -> None:
        alpine = rc.Terrain("alpine")
        xz = np.random.default_rng(2).uniform(-1e4, 1e4, (5, 7, 2))
        bodies, offsets = np.zeros((4, 3)), np.ones((2, 3, 2))
        for call, shape in ((alpine.heights, (5, 7)), (alpine.normals, (5, 7, 3)), (alpine.patches, (4, 2, 3))):
            asked = (bodies, offsets) if call == alpine.patches else (xz,)
            out = np.full(shape, np.nan, np.float32)
            self.assertIs(call(*asked, out=out), out)
            np.testing.assert_array_equal(out, call(*asked))
            frozen = np.zeros(shape, np.float32)
            frozen.flags.writeable = False
            for wrong in (np.zeros(shape), np.zeros((9,) + shape, np.float32), np.zeros(shape[::-1], np.float32).T, frozen, [0.0]):
                with self.assertRaisesRegex(rc.Invalid, "out is a contiguous array of float32"):
                    call(*asked, out=wrong)

    def test_what_is_no_real_number_is_refused(self) -> None:
        alpine = rc.Terrain("alpine")
        for wrong in (1j, np.array([[1, 2j]]), "ab", [["1", "2"]], None, [object(), object()]):
            with self.assertRaises(rc.Invalid):
                alpine.heights(wrong)
            with self.assertRaises(rc.Invalid):
                alpine.rays([0, 9000, 0], [0, -1, 0], reach=wrong)
        with self.assertRaises(rc.Invalid):
            alpine.rays(np.zeros((3, 3)), [0, -1, 0], reach=[1, 2])
        hits = alpine.rays([[0, 9000, 0]] * 2, [0, -1, 0], reach=[10, 10_000])
        np.testing.assert_array_equal(np.isinf(hits.distance), [True, False])

    def test_terrains_are_values(self) -> None:
        here = rc.Terrain("alpine", seed=3, parameters={"snowLine": 1500.5})
        for other in (pickle.loads(pickle.dumps(here)), copy.copy(here), copy.deepcopy(here)):
            self.assertEqual((other, hash(other), other.seed, other.parameters), (here, hash(here), 3, {"snowLine": 1500.5}))
        self.assertNotEqual(here, rc.Terrain("alpine", seed=4))
        self.assertNotEqual(here, "alpine")
        self.assertRegex(repr(here), r"alpine, seed 3, snowLine=1500\.5, hash [0-9a-f]{16}")

    def test_ctrl_c_ends_a_long_question(self) -> None:
        alpine, at = rc.Terrain("alpine"), np.zeros((8_000_000, 2))
        began = time.monotonic()
        alpine.heights(at)
        whole = time.monotonic() - began

        def interrupt(number: int, frame: object) -> None:
            raise KeyboardInterrupt

        before = signal.signal(signal.SIGALRM, interrupt)
        self.addCleanup(signal.signal, signal.SIGALRM, before)
        signal.setitimer(signal.ITIMER_REAL, 0.05 * whole)
        began = time.monotonic()
        with self.assertRaises(KeyboardInterrupt):
            alpine.heights(at)
        self.assertLess(time.monotonic() - began, 0.75 * whole)

    def test_threads_take_turns_at_the_ground_under_bodies(self) -> None:
        with rc.Terrain("alpine").standing(radius=20) as ground:
            over = threading.Event()

            def walk(turn: int) -> None:
                k = 0
                while not over.is_set():
                    k += 1
                    ground.move(np.full((3, 2), 10.0 * turn * k))
                    ground.changes()

            threads = [threading.Thread(target=walk, args=(turn,)) for turn in (1, -1, 2)]
            for thread in threads:
                thread.start()
            time.sleep(1)
            over.set()
            for thread in threads:
                thread.join()
            ground.wait(60)
            ground.changes()
            self.assertTrue(ground.tiles)
        with self.assertRaisesRegex(rc.Invalid, "closed"):
            ground.changes()

    def test_threads_share_a_terrain(self) -> None:
        alpine, at = rc.Terrain("alpine"), places(50_000)
        expected, wrong = alpine.heights(at), []

        def run() -> None:
            if not np.array_equal(alpine.heights(at), expected):
                wrong.append(1)

        threads = [threading.Thread(target=run) for _ in range(8)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        self.assertFalse(wrong)

    def test_it_lets_other_threads_run(self) -> None:
        alpine, at, turns, done = rc.Terrain("alpine"), places(1_000_000), [], threading.Event()

        def other() -> None:
            while not done.is_set():
                turns.append(1)
                time.sleep(0)

        thread = threading.Thread(target=other)
        thread.start()
        while not turns:
            time.sleep(0)
        before = len(turns)
        for _ in range(5):
            alpine.heights(at)
        after = len(turns)
        done.set()
        thread.join()
        self.assertGreater(after - before, 50)  # without the lock given back: one or two at most a call

    def test_patches_are_heights_around_bodies(self) -> None:
        alpine = rc.Terrain("alpine")
        random = np.random.default_rng(3)
        bodies = np.concatenate([random.uniform(-1e6, 1e6, (50, 4, 2)), random.uniform(-4, 4, (50, 4, 1))], axis=-1)
        right, behind = np.meshgrid(np.linspace(-0.5, 0.5, 11), np.linspace(-0.8, 0.8, 17))
        patches = alpine.patches(bodies, np.stack([right, behind], axis=-1))
        self.assertEqual((patches.shape, patches.dtype), ((50, 4, 17, 11), np.float32))
        for body, patch in zip(bodies.reshape(-1, 3), patches.reshape(-1, 17, 11)):
            sin, cos = np.sin(body[2]), np.cos(body[2])
            at = body[:2] + np.stack([cos * right + sin * behind, cos * behind - sin * right], axis=-1)
            np.testing.assert_allclose(patch, alpine.heights(at), atol=0.05)  # a step aside at most
        self.assertEqual(alpine.patches((1, 2, 0), (0, 0)).shape, ())
        self.assertEqual(alpine.patches((1, 2, 0), (0, 0)), alpine.height(1, 2))
        self.assertEqual(alpine.patches(np.zeros((0, 3)), np.zeros((5, 2))).shape, (0, 5))
        self.assertEqual(alpine.patches(np.zeros((5, 3)), np.zeros((0, 2))).shape, (5, 0))
        self.assertRaises(rc.Invalid, alpine.patches, [[0, 0]], [[0, 0]])

    def test_ground_goes_with_bodies(self) -> None:
        alpine = rc.Terrain("alpine")
        ground = alpine.standing(spacing=0.5, radius=20)
        random = np.random.default_rng(4)
        at = random.uniform(-1e6, 1e6, (300, 2))
        for _ in range(20):
            at += random.uniform(-3, 3, at.shape)
            ready = ground.move(at)
            self.assertEqual((ready.shape, ready.dtype), ((300,), bool))
            ground.wait(60)
            self.assertTrue(ground.move(at).all())
            ground.changes()
            for x, z in at:
                for dx, dz in ((-20, 0), (20, 0), (0, -20), (0, 20), (0, 0)):
                    self.assertIn((int(np.floor((x + dx) / 16)), int(np.floor((z + dz) / 16))), ground.tiles)
        for tile in list(ground.tiles.values())[:50]:
            across = np.arange(33) * tile.spacing
            x, z = np.meshgrid(tile.x + across, tile.z + across)
            np.testing.assert_array_equal(tile.heights, alpine.heights(np.stack([x, z], axis=-1)))
        first = next(iter(ground.tiles.values()))
        ground.move(np.zeros((0, 2)))
        gone, came = ground.changes()
        self.assertEqual((came, ground.tiles), ([], {}))
        self.assertIn(first, gone)
        self.assertEqual(first.heights.shape, (33, 33), "kept by who holds it")
        for bad in (dict(spacing=0.3), dict(spacing=-1), dict(radius=-1), dict(memory=0)):
            with self.assertRaises(rc.Invalid):
                alpine.standing(**bad)
        with self.assertRaisesRegex(rc.Invalid, "body 1 "):
            ground.move([[0, 0], [np.nan, 0]])


class ServerTest(unittest.TestCase):
    def test_a_server_ends_with_its_program(self) -> None:
        for end in ("os._exit(3)", "os.kill(os.getpid(), signal.SIGKILL)", "os.kill(os.getpid(), signal.SIGTERM)", "os.abort()"):
            program = "import os, signal, ridgecast as rc\ns = rc.server()\nprint(s.port, flush=True)\n" + end
            port = int(subprocess.run([sys.executable, "-c", program], capture_output=True, cwd="/").stdout)
            until = time.monotonic() + 60

            def answers() -> bool:
                try:
                    urllib.request.urlopen(f"http://127.0.0.1:{port}/healthz", timeout=5).close()
                    return True
                except OSError:
                    return False

            while answers() and time.monotonic() < until:
                time.sleep(0.05)
            self.assertFalse(answers(), end)


class WorldTest(unittest.TestCase):
    server: rc.Server

    @classmethod
    def setUpClass(cls) -> None:
        cls.server = rc.server("alpine", seed=5)

    @classmethod
    def tearDownClass(cls) -> None:
        cls.server.close()

    def test_heights_here_there_and_over_http_have_the_same_bits(self) -> None:
        at = np.round(places(40) * 256) / 256
        with rc.join(self.server.url, sensor=True) as world:
            here = world.heights(at)
            self.assertTrue(world.is_local)
        np.testing.assert_array_equal(rc.Terrain("alpine", seed=5).heights(at), here)
        with urllib.request.urlopen(self.server.http + "/v1/heights?" + "&".join(f"at={float(x)!r},{float(z)!r}" for x, z in at)) as answer:
            np.testing.assert_array_equal(np.array(json.load(answer)["heights"], np.float32), here)

    def test_ground_under_bodies_comes_from_a_server_too(self) -> None:
        with rc.join(self.server.url, session="bodies", terrain="canyon", seed=2, sensor=True) as world:
            ground = world.standing()
            ground.move([[100, 100]])
            ground.wait(60)
            ground.changes()
            tile = ground.tiles[3, 3]
            self.assertEqual(tile.heights[4, 4], world.height(100, 100))
            clock = world.clock
        np.testing.assert_array_equal(ground.tiles[3, 3].heights, tile.heights)
        for use in (lambda: world.height(0, 0), lambda: world.members, lambda: ground.move([[0, 0]]), lambda: clock.time, world.receive,
                    world.standing):
            self.assertRaises(rc.Invalid, use)
        world.close()

    def test_a_map_that_lies_here_needs_no_server(self) -> None:
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "hill.r16"
            file.write_bytes(np.random.default_rng(1).integers(0, 500, (64, 64)).astype("<u2").tobytes())
            options = "pitch=10"
            with rc.server(str(file), raster=options.split(), quiet=True) as server:
                hill, other = rc.Terrain(str(file), raster=options), rc.Terrain(str(file), raster="pitch=11")
                at = places(1000) % 400
                with rc.join(server.url) as asked, rc.join(server.url, terrain=hill) as local:
                    self.assertEqual((asked.is_local, local.is_local), (False, True))
                    np.testing.assert_array_equal(asked.heights(at), local.heights(at))
                    local.edit("crater", x=100, z=100, radius=30, depth=5)
                    np.testing.assert_array_equal(asked.heights(at), local.heights(at))
                    self.assertLess(local.height(100, 100), hill.height(100, 100) - 4)
                self.assertRaisesRegex(rc.Refused, "another|open the same file", rc.join, server.url, terrain=other)

    def test_what_the_ground_is_made_of(self) -> None:
        with tempfile.TemporaryDirectory() as folder:
            hill, cover = Path(folder) / "hill.asc", Path(folder) / "cover.asc"
            head = "ncols 4\nnrows 2\nxllcorner 0\nyllcorner 0\ncellsize 1\n"
            hill.write_text(head + "1 2 3 4\n" * 2)
            cover.write_text(head + "10 10 30 95\n" * 2)
            names = "pitch=10 class=10:forest class=30:grass"
            ground = rc.Terrain(str(hill), raster=names, classes=str(cover))
            self.assertEqual(ground.material_names[5:], ("grass", "asphalt", "concrete", "snow", "forest"))
            at = [[-20.0, 0], [-10, 0], [0, 0], [10, 0], [500, 0]]
            np.testing.assert_array_equal(ground.materials(at), [9, 9, 5, 0, 0])
            self.assertNotEqual(ground.hash, rc.Terrain(str(hill), raster="pitch=10").hash)
            self.assertEqual(pickle.loads(pickle.dumps(ground)), ground)
            hits = ground.rays([[-10, 50, 0], [0, 50, 0], [0, 50, 0]], [[0, -1, 0], [0, -1, 0], [0, 1, 0]])
            np.testing.assert_array_equal(ground.materials(hits.at), [9, 5, 0])
            self.assertRaisesRegex(rc.Invalid, "places", ground.materials, [1.0, 2, 3, 4])
            self.assertRaisesRegex(rc.Refused, "class=VALUE:NAME: it has 10, 30, 95", rc.Terrain, str(hill), raster="pitch=10",
                                   classes=str(cover))
            with rc.server(str(hill), raster=names.split(), classes=str(cover), quiet=True) as server, rc.join(server.url) as world:
                self.assertFalse(world.is_local)
                self.assertEqual(world.material_names, ground.material_names)
                self.assertEqual((world.known, ground.known), ("proven", "proven"))
                with urllib.request.urlopen(server.http + "/v1/sessions") as answer:
                    self.assertEqual(json.load(answer)["sessions"][0]["materials"], ["forest"])
                np.testing.assert_array_equal(world.materials(at), ground.materials(at))
                world.edit("level", x=-10, z=0, radius=2, height=5, material="gravel")
                np.testing.assert_array_equal(world.materials(at), [9, 3, 5, 0, 0])

    def test_sessions_are_made_and_joined(self) -> None:
        with rc.join(self.server.url, session="race", terrain="archipelago", seed=3, parameters={"heathLine": 640}, name="Ada") as ada:
            self.assertTrue(ada.is_local)
            self.assertEqual((ada.session, ada.terrain, ada.seed), ("race", "archipelago", 3))
            self.assertEqual(ada.hash, rc.Terrain("archipelago", seed=3, parameters={"heathLine": 640}).hash)
            with rc.join(self.server.url, session="race", name="Bob", sensor=True) as bob:
                until = time.monotonic() + 60
                while not bob.members and time.monotonic() < until:
                    time.sleep(0.01)
                self.assertEqual([m.name for m in bob.members], ["Ada"])
            with self.assertRaises(rc.Refused):
                rc.join(self.server.url, session="race", terrain="canyon")

    def test_ground_is_a_mesh_that_outlives_its_world(self) -> None:
        with rc.join(self.server.url, sensor=True) as world:
            mesh = world.ground((1e9, -200.5), 100, 0.5)
        positions, triangles = mesh.positions, mesh.triangles
        del mesh
        self.assertFalse(positions.flags.writeable)
        self.assertLess(triangles.max(), len(positions))
        heights = rc.Terrain("alpine", seed=5).heights(positions[:, [0, 2]].astype(np.float64) + (1e9, -200.5))
        np.testing.assert_allclose(positions[:, 1], heights, atol=0.5)
        a, b, c = (positions[triangles[:, k]] for k in range(3))
        self.assertTrue((np.cross(b - a, c - a)[:, 1] > 0).all(), "counter-clockwise from above")

    def test_members_change_the_ground(self) -> None:
        with rc.join(self.server.url + "?session=site&terrain=alpine&seed=2") as world:
            before = float(world.heights([[30, 40]])[0])
            number = world.edit("crater", x=30, z=40, radius=8, depth=3, material="gravel")
            self.assertEqual(number, 1)
            self.assertAlmostEqual(float(world.heights([[30, 40]])[0]), before - 3, delta=0.01)
            self.assertEqual(world.undo(number), 2)
            self.assertEqual(float(world.heights([[30, 40]])[0]), before)
            with self.assertRaisesRegex(rc.Refused, "depth"):
                world.edit("crater", x=30, z=40, radius=8)
            self.assertEqual(world.edit("crater", x=np.float32(30), z=np.int64(40), radius=np.float64(8), depth=np.float32(3)), 3)
            self.assertEqual(world.edit("road", line=np.array([[0, 0], [20, 5]]), width=np.array(4.0)), 4)
            with self.assertRaisesRegex(rc.Invalid, "complex"):
                world.edit("crater", x=1j, z=40, radius=8, depth=3)

    def test_a_world_that_is_closed_takes_its_ground_along(self) -> None:
        with rc.join(self.server.url + "?session=steps&terrain=alpine", clock="stepped") as owner:
            follower = rc.join(self.server.url + "?session=steps", follow=True)
            ground = follower.standing()
            ground.move([[0, 0]])
            follower.close()
            until = time.monotonic() + 60
            while owner.others and time.monotonic() < until:
                owner.place(0, 1000, 0)
                time.sleep(0.01)
            self.assertEqual(owner.others, 0)
            owner.clock.step(0.1, timeout=60)
            with self.assertRaisesRegex(rc.Invalid, "closed"):
                ground.move([[0, 0]])

    def test_ground_under_bodies_follows_edits(self) -> None:
        with tempfile.TemporaryDirectory() as folder:
            hill = Path(folder, "hill.asc")
            hill.write_text("ncols 9\nnrows 9\nxllcorner 0\nyllcorner 0\ncellsize 30\n" + 9 * "500 503 499 501 507 502 500 498 500\n")
            server = rc.server(hill)
            self.addCleanup(server.close)
            for local, url in (True, self.server.url + "?session=pit&terrain=alpine&seed=2"), (False, server.url):
                with rc.join(url, sensor=True) as world, rc.join(url, sensor=True) as other:
                    self.assertEqual(world.is_local, local)
                    ground = world.standing()
                    ground.move([[0, 0]])
                    ground.wait(60)
                    ground.changes()
                    before, tiles, unedited = world.height(3, 4), dict(ground.tiles), world.hash
                    self.assertEqual({tile.edit for tile in tiles.values()}, {0})
                    number = world.edit("crater", x=3, z=4, radius=5, depth=6)
                    ground.move([[0, 0]])
                    ground.wait(60)
                    gone, came = ground.changes()
                    self.assertEqual(sorted((t.i, t.j) for t in gone), sorted((t.i, t.j) for t in came))
                    self.assertIn((0, 0), {(t.i, t.j) for t in came})
                    self.assertEqual({t.edit for t in came}, {number})
                    self.assertEqual(ground.tiles.keys(), tiles.keys())
                    self.assertEqual(ground.tiles[0, 0].heights[4, 3], world.height(3, 4))
                    self.assertLess(world.height(3, 4), before - 5.9)
                    self.assertNotEqual(world.hash, unedited)
                    # Also an edit of another member, once it is heard of; and its hash is the same.
                    other.undo(number)
                    until = time.monotonic() + 60
                    while ground.tiles[0, 0].heights[4, 3] != np.float32(before) and time.monotonic() < until:
                        ground.move([[0, 0]])
                        ground.wait(60)
                        ground.changes()
                    self.assertEqual(ground.tiles[0, 0].heights[4, 3], np.float32(before))
                    self.assertEqual(ground.tiles[0, 0].edit, number + 1)
                    self.assertEqual(world.hash, other.hash)
                    ground.close()

    def test_a_camera_holds_the_servers_mesh(self) -> None:
        with rc.join(self.server.url, threshold=2) as world:
            world.camera(0, 1500, 0)
            versions = {(l.level, l.i, l.j): l.version for l in world.leaves}
            seen = world.camera(1000, 1200, 0)
            while not seen.settled:
                seen = world.receive()
            self.assertEqual(sum(l.triangles for l in world.leaves), seen.triangles)
            self.assertEqual(len(world.mesh().triangles), seen.triangles)
            self.assertTrue({(l.level, l.i, l.j) for l in world.leaves} & versions.keys())
            changed = [l for l in world.leaves if versions.get((l.level, l.i, l.j)) != l.version]
            self.assertTrue(changed)
            self.assertEqual(len(world.leaf(changed[0]).triangles), changed[0].triangles)
            self.assertEqual(world.mesh().error, np.inf)
        with rc.join(self.server.url, threshold=2, errors=True) as world:
            world.camera(0, 1500, 0)
            near = world.leaf(next(l for l in world.leaves if l.side * l.i <= 10 < l.side * (l.i + 1) and l.side * l.j <= 10 < l.side * (l.j + 1)))
            self.assertLess(near.error, 100)
            corners = near.positions[:, [0, 2]].astype(float) + near.origin
            off = np.abs(world.heights(corners) - near.positions[:, 1])
            self.assertTrue((off <= near.error + 1e-3).all())

    def test_lock_step_flights_repeat(self) -> None:
        def fly() -> list:
            with rc.join(self.server.url, lockstep=True, threshold=4) as world:
                return [world.camera(40.0 * t, 1500, 5.0 * t).hash for t in range(10)]

        self.assertEqual(fly(), fly())

    def test_a_session_may_begin_stepped(self) -> None:
        with rc.join(self.server.url, session="still", terrain="alpine", clock="stepped", sensor=True) as world:
            time.sleep(0.05)
            self.assertEqual((world.clock.mode, world.clock.time), ("stepped", 0))
            world.clock.step(0.25)
            self.assertEqual(world.clock.time, 0.25)
            world.clock.jump(1800.5)
            self.assertEqual((world.clock.mode, world.clock.time, world.clock.end), ("stepped", 1800.5, None))
            self.assertRaisesRegex(rc.Refused, "recordings", world.clock.jump, 1)
            self.assertRaises(rc.Invalid, world.clock.jump, -1)
            self.assertRaises(rc.Refused, rc.join, self.server.url, session="still", terrain="alpine", clock="real-time")

    def test_steps_wait_for_those_who_follow(self) -> None:
        with rc.join(self.server.url, session="steps", terrain="alpine", sensor=True) as owner, \
                rc.join(self.server.url, session="steps", name="late", sensor=True, follow=True) as late, \
                rc.join(self.server.url, session="steps", name="bystander"):
            owner.clock.set("stepped")
            begin = owner.clock.time
            with self.assertRaisesRegex(TimeoutError, "late|step"):
                owner.clock.step(0.5, timeout=0.5)
            self.assertAlmostEqual(late.clock.next(), begin + 0.5)
            times = []
            thread = threading.Thread(target=lambda: [times.append(late.clock.next()) for _ in range(20)])
            thread.start()
            owner.clock.step(0)
            for _ in range(19):
                owner.clock.step(0.02)
            self.assertRaises(rc.Timeout, owner.clock.step, 0.02, timeout=0.2)
            thread.join()
            np.testing.assert_allclose(times, begin + 0.5 + 0.02 * np.arange(1, 21))
            self.assertRaises(rc.Refused, late.clock.set, "real-time")

    def members(self, session: str) -> int:
        with urllib.request.urlopen(self.server.http + "/v1/sessions") as answer:
            found = [s for s in json.load(answer)["sessions"] if s["name"] == session]
        return int(found[0]["members"]) if found else 0

    def await_members(self, session: str, count: int) -> None:
        until = time.monotonic() + 60
        while self.members(session) != count and time.monotonic() < until:
            time.sleep(0.02)
        self.assertEqual(self.members(session), count)

    def test_what_is_read_after_a_step_is_of_that_step(self) -> None:
        url, steps = self.server.url + "?session=alike&terrain=alpine", 300
        with rc.join(url, clock="stepped", name="owner") as owner:
            followers = [rc.join(url, follow=True, sensor=True, name=f"follower-{k}") for k in range(8)]
            old = []

            def run(world: rc.World) -> None:
                for step in range(1, steps + 1):
                    world.clock.next(60)
                    # Of the last step, or of this one already, where another was faster.
                    old.extend((step, m) for m in world.members if step > 1 and m.name != "owner" and int(m.state) not in (step - 1, step))
                    world.place(0, 1000 + step, 0, state=str(step).encode())
                with contextlib.suppress(rc.Error):  # it is closed
                    world.clock.next(60)

            threads = [threading.Thread(target=run, args=(world,)) for world in followers]
            for thread in threads:
                thread.start()
            for step in range(1, steps + 1):
                owner.clock.step(0.01, timeout=60)
                members = owner.members
                self.assertEqual(len(members), 8)
                old.extend((step, m) for m in members if m.state != str(step).encode())
            self.assertEqual(old[:3], [], len(old))
            for world in followers:
                world.close()
            for thread in threads:
                thread.join()

    def test_a_world_that_is_forgotten_is_left(self) -> None:
        worlds = [rc.join(self.server.url, session="forgotten", terrain="alpine", sensor=True) for _ in range(3)]
        self.await_members("forgotten", 3)
        clock = worlds[0].clock
        del worlds
        self.await_members("forgotten", 0)
        self.assertRaises(rc.Invalid, lambda: clock.time)

    def test_a_world_is_closed_while_others_wait_in_it(self) -> None:
        for _ in range(5):
            world, ends = rc.join(self.server.url, session="closed", terrain="alpine", sensor=True, follow=True), []

            def wait() -> None:
                try:
                    world.clock.next(timeout=600)
                except rc.Error as e:
                    ends.append(e)

            threads = [threading.Thread(target=wait) for _ in range(3)]
            for thread in threads:
                thread.start()
            time.sleep(0.05)
            world.close()
            for thread in threads:
                thread.join(60)
            self.assertEqual([type(e) for e in ends], [rc.Invalid] * 3)

    def test_a_forked_process_leaves_the_world_alone(self) -> None:
        with rc.join(self.server.url, session="forked", terrain="alpine", sensor=True) as world:
            child = os.fork()
            if child == 0:
                try:
                    world.members
                except rc.Invalid:
                    world.close()
                    os._exit(int(rc.Terrain("alpine").height(1, 2) != rc.Terrain("alpine").height(1, 2)))
                os._exit(2)
            self.assertEqual(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), 0)
            self.assertEqual(world.members, [])
            self.await_members("forked", 1)

    def test_members_say_where_and_how_they_are(self) -> None:
        with rc.join(self.server.url, session="state", terrain="alpine", sensor=True, name="rover") as rover, \
                rc.join(self.server.url, session="state", sensor=True) as other:
            until = time.monotonic() + 60
            while not (other.members and other.members[0].position) and time.monotonic() < until:
                rover.place(1e9, 2000, -0.25, state=b"wheels\0\xff")
                time.sleep(0.02)
            self.assertEqual(other.members[0].position, (1e9, 2000, -0.25))
            self.assertEqual(other.members[0].state, b"wheels\0\xff")
            with self.assertRaises(rc.Invalid):
                rover.place(0, 0, 0, state=bytes(257))

    def test_a_server_that_stops_for_a_while_is_waited_for(self) -> None:
        with rc.server("alpine", seed=5) as server, rc.join(server.url, sensor=True) as world:
            for _ in range(2):
                before = world.clock.time
                os.kill(server._process.pid, signal.SIGSTOP)
                threading.Timer(0.6, lambda: os.kill(server._process.pid, signal.SIGCONT)).start()
                world.clock.step(1)
                self.assertGreaterEqual(round(world.clock.time * 1e6), round(before * 1e6) + 1_000_000)

    def test_a_killed_server_is_told_and_waited_for(self) -> None:
        with rc.server("alpine", seed=5) as first:
            world = rc.join(first.url, timeout=20)
            world.camera(0, 1500, 0)
            port = first.port
        for call in (lambda: world.ground((0, 0), 50, 1, timeout=0.5), lambda: world.camera(0, 1500, 0, timeout=0.5),
                     lambda: world.clock.step(1, timeout=0.5)):
            began = time.monotonic()
            with self.assertRaises(rc.Lost):
                call()
            self.assertGreater(time.monotonic() - began, 0.4)
        self.assertEqual(len(world.heights([[0, 0]])), 1, "computed here")
        back: list = []
        timer = threading.Timer(1, lambda: back.append(rc.server("alpine", seed=5, port=port)))
        timer.start()
        world.camera(0, 1500, 0, timeout=60)
        timer.join()
        with back[0]:
            self.assertGreater(len(world.ground((0, 0), 50, 1).triangles), 0)
            world.camera(0, 1500, 0)
            self.assertEqual(world.reconnections, 1)
            world.close()

    def test_ctrl_c_ends_what_waits(self) -> None:
        program = ("import ridgecast as rc, sys\n"
                   "w = rc.join(sys.argv[1], sensor=True); w.clock.set('stepped'); print('waits', flush=True)\n"
                   "f = rc.join(sys.argv[1], sensor=True, follow=True)\n"
                   "try: f.clock.next(timeout=600)\n"
                   "except KeyboardInterrupt: print('interrupted')")
        process = subprocess.Popen([sys.executable, "-c", program, self.server.url + "?session=interrupted&terrain=alpine"],
                                   stdout=subprocess.PIPE, text=True)
        assert process.stdout
        self.assertEqual(process.stdout.readline(), "waits\n")
        time.sleep(0.5)
        process.send_signal(signal.SIGINT)
        self.assertEqual(process.communicate(timeout=60)[0], "interrupted\n")

    def test_a_snapshot_is_read(self) -> None:
        url = self.server.http + "/v1/sessions/default/snapshot.glb?x0=1000000000&z0=0&x1=1000000200&z1=200&error=0.5"
        with urllib.request.urlopen(url) as answer:
            data = answer.read()
        mesh = rc.read_glb(data)
        heights = rc.Terrain("alpine", seed=5).heights(mesh.positions[:, [0, 2]].astype(np.float64) + mesh.origin)
        np.testing.assert_allclose(mesh.positions[:, 1], heights, atol=0.5)
        for end in (0, 3, 11, 19, 20, 60, len(data) // 2, len(data) - 1):
            with self.assertRaises(rc.Invalid):
                rc.read_glb(data[:end])
        size = int.from_bytes(data[12:16], "little")
        repeated = json.loads(data[20:20 + size])
        for view in repeated["bufferViews"]:
            view["byteStride"] = 0
        for text in (json.dumps(repeated), "[]", "[" * 100_000):
            with self.assertRaises(rc.Invalid):
                rc.read_glb(data[:12] + len(text).to_bytes(4, "little") + b"JSON" + text.encode() + data[20 + size:] + bytes(size))
        with urllib.request.urlopen(url + "&compression=draco") as answer:
            with self.assertRaisesRegex(rc.Invalid, "compression"):
                rc.read_glb(answer.read())

    def test_what_is_wrong_is_said(self) -> None:
        with self.assertRaisesRegex(rc.Refused, "start one with"):
            rc.join("ws://127.0.0.1:1")
        with self.assertRaises(rc.Invalid):
            rc.join("ftp://nowhere")
        with rc.join(self.server.url) as world:
            with self.assertRaises(rc.Invalid):
                world.camera(0, 0, 0, pitch=9)
            with self.assertRaises(rc.Invalid):
                world.ground((0, 0), 1e6, 1)
            with self.assertRaises(ValueError):
                world.clock.set("backwards")
        with self.assertRaisesRegex(rc.Refused, "terrain"):
            rc.server("nothing")


if __name__ == "__main__":
    unittest.main(verbosity=2)
