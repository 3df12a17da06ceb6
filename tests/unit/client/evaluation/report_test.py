"""The report of an evaluation: what the worst case of each requirement is, the figures of repeated flights, and tables as text.

    report_test.py FOLDER-OF-report.py
"""

import json
import sys
import tempfile
import unittest
from pathlib import Path
from typing import Any

try:
    import matplotlib
    import PIL
except ImportError as missing:
    print(f"SKIPPED: {missing}: ./run install python")
    sys.exit(77)

sys.path.insert(0, sys.argv.pop())
sys.dont_write_bytecode = True
import report  # noqa: E402

Json = dict[str, Any]


def mesh(triangles: float, ssim: float, mesh_ms: float, march_ms: list[float]) -> Json:
    def picture(samples: int, filtered: bool, all_of_it: float, terrain: float) -> Json:
        return {"samples": samples, "filtered": filtered, "mesh": {"ssim": all_of_it, "terrain": terrain}}

    pictures = [picture(1, True, ssim - 0.01, ssim), picture(4, True, ssim, ssim - 0.02), picture(16, False, ssim, ssim)]
    return {"triangles": triangles, "pictures": pictures,
            "times": {"mesh_ms": [mesh_ms], "mesh_cpu_ms": [mesh_ms], "march_ms": march_ms, "march_cpu_ms": march_ms}}


def view(name: str, *meshes: Json) -> Json:
    return {"terrain": "canyon", "view": name, "meshes": list(meshes)}


class Flights(unittest.TestCase):
    def setUp(self) -> None:
        self.scratch = tempfile.TemporaryDirectory()
        self.addCleanup(self.scratch.cleanup)
        self.folder = Path(self.scratch.name)

    def flight(self, name: str, summary: Json, iterations: str = "", others: float | None = None, **run: Any) -> report.Flight:
        folder = self.folder / name
        folder.mkdir()
        (folder / "summary.json").write_text(json.dumps({"ssim_frames": [], "frames_t": [], **summary}))
        (folder / "iterations.jsonl").write_text(iterations)
        (folder / "machine.json").write_text(json.dumps({"others": others}))
        run = {"name": name, "terrain": "canyon", "metric": "pixels", "threshold": 1, "threads": 0, "repeat": 1, "folder": name, **run}
        return report.Flight(run, self.folder)

    def test_the_worst_of_each_is_what_counts(self) -> None:
        flown = self.flight("canyon-area-0.3-r1", {"frames": 16, "ssim_mean": 0.93, "ssim_mean_terrain": 0.91}, metric="area", threshold=0.3)
        rested = self.flight("canyon-standing-r1", {"popping_off": 0.3, "popping_on": 0.15, "hash_mismatches": 2})
        table = report.targets_of([], [flown, rested])
        rows = {row[0]: row[1:] for row in table.rows}
        self.assertEqual(rows["canyon, along the flight at 50 m/s"], ["at least 0.920", "0.930", "mean of 16 pictures", "yes"])
        self.assertEqual(rows["canyon, along the flight at 50 m/s, terrain alone"][3], "no")
        self.assertEqual(rows["largest change between frames while a mesh refines, with morphing as a share of without"],
                         ["at most 0.333", "0.500", "canyon", "no"])
        self.assertEqual(rows["iterations after which a client's mesh differed from the server's"][2], "canyon-standing-r1")
        self.assertEqual(len(rows), 4)  # what was not measured has no row

    def test_repeats_are_one_row_of_their_median_and_half_their_range(self) -> None:
        summary = {"frames": 1, "ssim_mean": 0.9, "iterations": 20, "triangles": 7, "mesh_frame_ms": 10}
        lines = '{"bytes": 100, "upload_ms": 1, "draw_ms": 2}\n{"bytes": 300, "upload_ms": 5, "draw_ms": 2}\n{"torn'
        flights = [self.flight(f"a-r{k}", {**summary, "iterations_per_second": rate}, lines, 0.25)
                   for k, rate in enumerate((4.0, 5.0, 8.0), 1)]
        tables = {table.name: table for table in report.flight_tables(flights)}

        def figure(name: str, title: str) -> str:
            (row,) = tables[name].rows
            self.assertEqual(row[0], "a")
            return row[tables[name].header.index(title)]

        self.assertEqual(figure("rates", "iterations/s"), "5.0 ± 2.0")
        self.assertEqual(figure("rates", "machine taken by others"), "25 %")
        self.assertEqual(figure("rates", "corrected frames/s"), "")  # not measured
        self.assertEqual(figure("stream", "bytes an iteration"), "200")
        self.assertEqual(figure("frames", "frames"), "2")
        self.assertEqual([figure("frames", title) for title in ("above 2 x the median", "because of uploads")], ["1", "1"])
        self.assertEqual(set(tables), {"flights", "rates", "stages", "stream", "frames"})
        header, first, *_ = report.runs_csv(flights).split("\r\n")
        self.assertEqual(header.split(",")[:7], ["flight", "terrain", "metric", "threshold", "threads", "repeat", "frames"])
        self.assertEqual(first.split(",")[:8], ["a-r1", "canyon", "pixels", "1", "0", "1", "1", "0.9"])
        self.assertEqual(len(first.split(",")), 36)

    def test_what_is_broken_is_named(self) -> None:
        (self.folder / "summary.json").write_text("{")
        with self.assertRaisesRegex(SystemExit, "summary.json is broken; remove it"):
            report.read(self.folder / "summary.json", "remove it")
        with self.assertRaisesRegex(SystemExit, "parts.json is broken"):
            report.write_report(self.folder)

    def test_plots_are_pictures(self) -> None:
        flown = self.flight("a-r1", {"ssim_frames": [0.9, 0.8], "frames_t": [1, 2]}, '{"bytes": 1, "triangles_held": 5}')
        plots = report.plots_of([flown])
        self.assertEqual(set(plots), {"triangles.svg", "bytes.svg", "stages.svg", "likeness.svg", "likeness-along.svg"})
        for svg in plots.values():
            self.assertTrue(svg.startswith("<svg") and svg.rstrip().endswith("</svg>"))


class Views(unittest.TestCase):
    def test_the_worst_view_of_the_finest_mesh_that_is_allowed(self) -> None:
        views = [view("low", mesh(100_000, 0.5, 100, [1000]), mesh(499_000, 0.99, 100, [1000])),
                 view("grazing", mesh(400_000, 0.96, 100, [1000]), mesh(600_000, 0.1, 100, [1000]))]
        table = report.targets_of(views, [])
        rows = {row[0]: row[1:] for row in table.rows}
        self.assertEqual(rows["canyon, camera at rest, filtered, 2x2 samples"], ["at least 0.950", "0.960", "grazing", "yes"])
        self.assertEqual(rows["canyon, camera at rest, filtered, 2x2 samples, terrain alone"][3], "no")
        self.assertEqual(rows["canyon, camera at rest, unfiltered, 4x4 samples"][1], "0.960")
        for row in table.rows:
            self.assertEqual(len(row), len(table.header))

    def test_speed_counts_where_the_picture_is_good_by_the_median_march(self) -> None:
        table = report.targets_of([view("low", mesh(1, 0.9, 1000, [900, 5000]), mesh(2, 0.97, 100, [1000]))], [])
        rows = {row[0]: row[1:] for row in table.rows}
        self.assertEqual(rows["a picture of the mesh, faster than ray marching where SSIM is at least 0.95"][1:], ["10.0", "canyon low", "yes"])


class Tables(unittest.TestCase):
    table = report.Table("name", "A <title>", "A note.", ["what", "a, b"], [['x "y"', "1"], ["z", ""]])

    def test_as_text(self) -> None:
        self.assertEqual(self.table.csv(), 'what,"a, b"\r\n"x ""y""",1\r\nz,\r\n')
        self.assertIn("<h3>A &lt;title&gt;</h3>", self.table.html())
        self.assertIn("<td>x &quot;y&quot;", self.table.html())
        self.assertEqual(report.Table("n", "Title", "", ["a", "b"], [["1", "2"]]).markdown(), "## Title\n\n| a | b |\n|---|--:|\n| 1 | 2 |\n\n")

    def test_what_is_no_number_is_an_empty_cell(self) -> None:
        self.assertEqual([report.cell("%.2f", value) for value in (1005, float("nan"), float("inf"))], ["1005.00", "", ""])


if __name__ == "__main__":
    unittest.main()
