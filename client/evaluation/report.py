"""Writes the report of `ridgecast-client evaluate`: its tables as CSV, its plots as SVG, everything as one page (report.html, which needs
no network) and as a document (report.md).

    python3 report.py [FOLDER]        # its own folder; what parts.json names there is reported
"""

import base64
import csv
import html
import io
import json
import math
import sys
from dataclasses import dataclass, field
from itertools import accumulate
from pathlib import Path
from typing import Any, Callable, Iterable

try:
    import matplotlib
    from matplotlib.figure import Figure
    from PIL import Image
except ImportError as missing:
    sys.exit(f"The results are there, but not their report ({missing}): install python3-matplotlib, and run it again with --report.")

Json = dict[str, Any]
STAGES = ("select", "generate", "refine", "triangulate", "encode", "apply")
# Of summary.json, in runs.csv.
NUMBERS = """frames ssim_mean ssim_min ssim_mean_terrain ssim_mean_unfiltered ssim_mean_corrected ssim_settled ssim_settled_terrain
    ssim_settled_unfiltered ssim_settled_corrected triangles iterations_per_second mesh_frame_ms mesh_frame_cpu_ms corrected_frame_ms
    corrected_frame_cpu_ms raymarch_frame_ms raymarch_frame_cpu_ms bytes_received iterations hash_mismatches settle_seconds leaves
    latency_ms_mean latency_ms_max width height samples popping_off popping_on""".split()


# ---- numbers: what was not measured is nan ----


def number(of: Json, key: str) -> float:
    value = of.get(key)
    return float(value) if isinstance(value, (int, float)) else math.nan


def share(values: Iterable[float], part: float) -> float:
    """The quantile of this part, 0..1."""
    ordered = sorted(values)
    return ordered[int(part * (len(ordered) - 1))] if ordered else math.nan


def median(values: Iterable[float]) -> float:
    ordered = sorted(values)
    return ordered[len(ordered) // 2] if ordered else math.nan


def mean(values: list[float]) -> float:
    return sum(values) / len(values) if values else math.nan


def ratio(a: float, b: float) -> float:
    return a / b if b else math.nan


def cell(form: str, value: float) -> str:
    return form % value if math.isfinite(value) else ""


# ---- tables ----


@dataclass
class Table:
    name: str  # of its file
    title: str
    note: str
    header: list[str]
    rows: list[list[str]] = field(default_factory=list)

    def html(self) -> str:
        note = f"<p>{html.escape(self.note)}</p>\n" if self.note else ""
        head = "".join(f"<th>{html.escape(title)}" for title in self.header)
        body = "".join("\n<tr>" + "".join(f"<td>{html.escape(text)}" for text in row) for row in self.rows)
        return f'<h3>{html.escape(self.title)}</h3>\n{note}<div class="wide"><table><tr>{head}{body}\n</table></div>\n'

    def markdown(self) -> str:
        rule = "|---|" + "--:|" * (len(self.header) - 1)
        lines = ["| " + " | ".join(row) + " |" for row in [self.header, *self.rows]]
        return "\n".join([f"## {self.title}\n", *([self.note + "\n"] if self.note else []), lines[0], rule, *lines[1:]]) + "\n\n"

    def csv(self) -> str:
        out = io.StringIO()
        csv.writer(out).writerows([self.header, *self.rows])
        return out.getvalue()


# ---- flights ----


class Flight:
    def __init__(self, run: Json, folder: Path):
        self.folder = folder / run["folder"]
        self.name, self.terrain, self.metric = run["name"], run["terrain"], run["metric"]
        self.threshold, self.threads, self.repeat = float(run["threshold"]), int(run["threads"]), int(run["repeat"])
        self.summary = read(self.folder / "summary.json", "remove the folder to fly it again")
        self.iterations = []
        for line in (self.folder / "iterations.jsonl").read_text().splitlines():
            try:
                self.iterations.append(json.loads(line))
            except ValueError:
                pass  # torn where a flight was cut off
        self.others = others_of(self.folder)

        self.setting: str = self.name[: self.name.rfind("-r")]  # of all its repeats
        self.like: list[float] = self.summary["ssim_frames"]

    def of(self, key: str) -> float:
        return number(self.summary, key)

    def each(self, *keys: str) -> list[float]:
        """The sums of these of all iterations that have them."""
        sums = (sum(number(i, key) for key in keys) for i in self.iterations)
        return [value for value in sums if not math.isnan(value)]

    def rate(self, key: str) -> float:
        """Of all iterations, in a second in which iterations ran."""
        return ratio(sum(self.each(key)) * self.of("iterations_per_second"), self.of("iterations"))


Column = tuple[str, str, Callable[[Flight], float]]


def flight_table(name: str, title: str, note: str, settings: list[list[Flight]], columns: list[Column]) -> Table:
    """A row for each setting: the median of its repeats and half their range."""

    def spread(flights: list[Flight], form: str, value: Callable[[Flight], float]) -> str:
        values = [v for v in map(value, flights) if math.isfinite(v)]
        half = (max(values) - min(values)) / 2 if values else 0
        return cell(form, median(values)) + (" ± " + cell(form, half) if half > 0 else "")

    rows = [[flights[0].setting, *(spread(flights, form, value) for _, form, value in columns)] for flights in settings]
    return Table(name, title, note, ["flight", *(title for title, _, _ in columns)], rows)


def of(title: str, form: str, key: str) -> Column:
    return title, form, lambda f: f.of(key)


def quantile(title: str, form: str, part: float, *keys: str) -> Column:
    return title, form, lambda f: share(f.each(*keys), part)


def flight_tables(flights: list[Flight]) -> list[Table]:
    by_name: dict[str, list[Flight]] = {}
    for flight in flights:
        by_name.setdefault(flight.setting, []).append(flight)
    settings = list(by_name.values())
    pictured = [s for s in settings if s[0].of("frames") > 0]  # those without pictures have tables of their own
    drawn = [s for s in settings if s[0].each("upload_ms")]
    popped = [s for s in settings if not math.isnan(s[0].of("popping_off"))]
    threaded = next((s[0] for s in settings if s[0].threads > 0), None)

    def beside(f: Flight) -> bool:
        like = threaded is not None and (f.terrain, f.metric, f.threshold) == (threaded.terrain, threaded.metric, threaded.threshold)
        return f.threads > 0 or (like and "standing" not in f.name and "frames" not in f.name)

    def slow(f: Flight, by_upload: bool) -> float:
        """Frames above twice the median; by_upload: only those that are not without their upload."""
        frames = list(zip(f.each("upload_ms", "draw_ms"), f.each("draw_ms")))
        most = 2 * share((whole for whole, _ in frames), 0.5)
        return sum(whole > most and (not by_upload or draw <= most) for whole, draw in frames)

    stages = [f"{stage}_ms" for stage in STAGES]
    tables = [
        flight_table(
            "flights", "Along the flights: likeness",
            "SSIM of the streamed mesh, as it is and corrected, against the converged ray march: during the flight, settled at its end.",
            pictured,
            [("pictures", "%.0f", lambda f: f.of("frames") or math.nan),  # repeats have none
             of("SSIM mean", "%.4f", "ssim_mean"), of("corrected", "%.4f", "ssim_mean_corrected"),
             ("median", "%.4f", lambda f: median(f.like)), of("least", "%.4f", "ssim_min"),
             of("terrain alone", "%.4f", "ssim_mean_terrain"), of("unfiltered", "%.4f", "ssim_mean_unfiltered"),
             of("settled", "%.4f", "ssim_settled"), of("settled, corrected", "%.4f", "ssim_settled_corrected"),
             of("settled, terrain alone", "%.4f", "ssim_settled_terrain"), of("triangles settled", "%.0f", "triangles"),
             of("hashes that differed", "%.0f", "hash_mismatches")]),
        flight_table(
            "rates", "Along the flights: rates",
            "Frames: each rendering drawn alone, medians. A place is ray-marched once for all flights over a terrain, so only CPU time "
            "compares the two. Iterations: lock-step, one pose each. Nodes are those that the server generated; each inserted vertex makes "
            "two triangles.",
            pictured,
            [("mesh frames/s", "%.2f", lambda f: ratio(1e3, f.of("mesh_frame_ms"))),
             ("corrected frames/s", "%.2f", lambda f: ratio(1e3, f.of("corrected_frame_ms"))),
             ("ray march frames/s", "%.3f", lambda f: ratio(1e3, f.of("raymarch_frame_ms"))),
             ("mesh faster by CPU time", "%.1f", lambda f: ratio(f.of("raymarch_frame_cpu_ms"), f.of("mesh_frame_cpu_ms"))),
             of("iterations/s", "%.1f", "iterations_per_second"),
             ("nodes generated/s", "%.0f", lambda f: f.rate("leaves_generated")),
             ("nodes in sight", "%.0f", lambda f: mean(f.each("leaves_visible"))),
             ("drawn/s", "%.0f", lambda f: ratio(1e3 * mean(f.each("leaves_visible")), f.of("mesh_frame_ms"))),
             ("vertices inserted/s", "%.0f", lambda f: f.rate("inserted")), ("removed/s", "%.0f", lambda f: f.rate("removed")),
             ("triangles held", "%.0f", lambda f: mean(f.each("triangles_held"))),
             ("triangles drawn/s, million", "%.2f", lambda f: ratio(mean(f.each("triangles_held")), 1e3 * f.of("mesh_frame_ms"))),
             ("machine taken by others", "%.0f %%", lambda f: 100 * f.others)]),
        flight_table(
            "stages", "Time of each stage",
            "Milliseconds of an iteration: medians, and the 99th percentile of the total. Apply is the client's decoding and applying.",
            pictured,
            [*(quantile(stage, "%.2f", 0.5, f"{stage}_ms") for stage in STAGES),
             quantile("all", "%.1f", 0.5, *stages), quantile("p99", "%.1f", 0.99, *stages)]),
        flight_table(
            "threads", "Number of threads", "Default: every core of the server's machine.",
            [s for s in settings if threaded and beside(s[0])],
            [of("iterations/s", "%.1f", "iterations_per_second"),
             *(quantile(f"{stage} ms", "%.2f", 0.5, f"{stage}_ms") for stage in ("generate", "refine", "triangulate", "encode")),
             quantile("latency ms, median", "%.1f", 0.5, "latency_ms")]),
        flight_table(
            "stream", "The stream",
            "Latency from sending a pose to holding its mesh. Bytes a second: per second of wall time in which iterations ran.", pictured,
            [("megabytes", "%.2f", lambda f: f.of("bytes_received") / 1e6),
             ("kB/s", "%.0f", lambda f: ratio(f.of("bytes_received") * f.of("iterations_per_second"), 1e3 * f.of("iterations"))),
             ("bytes an iteration", "%.0f", lambda f: mean(f.each("bytes"))),
             quantile("latency ms, median", "%.1f", 0.5, "latency_ms"), quantile("p99", "%.1f", 0.99, "latency_ms"),
             of("worst", "%.1f", "latency_ms_max"), of("settled after s", "%.2f", "settle_seconds")]),
        flight_table(
            "frames", "Frames along the flights, uploads included",
            "One frame an iteration, at a quarter of the size. Message to uploaded: decoding, applying and uploading.", drawn,
            [("frames", "%.0f", lambda f: len(f.iterations)),
             quantile("frame ms, median", "%.1f", 0.5, "upload_ms", "draw_ms"), quantile("p99", "%.1f", 0.99, "upload_ms", "draw_ms"),
             quantile("upload ms, median", "%.2f", 0.5, "upload_ms"), quantile("p99", "%.2f", 0.99, "upload_ms"),
             quantile("message to uploaded ms, p99", "%.2f", 0.99, "upload_ms", "apply_ms"),
             ("above 2 x the median", "%.0f", lambda f: slow(f, False)), ("because of uploads", "%.0f", lambda f: slow(f, True))]),
        flight_table(
            "popping", "Popping",
            "The largest change (1 - SSIM) between consecutive frames while the mesh of a camera at rest refines, 60 frames a second.",
            popped,
            [of("morphing off", "%.4f", "popping_off"), of("morphing on", "%.4f", "popping_on"),
             ("of it left", "%.3f", lambda f: ratio(f.of("popping_on"), f.of("popping_off")))]),
    ]
    return [table for table in tables if table.rows]


def runs_csv(flights: list[Flight]) -> str:
    header = ["flight", "terrain", "metric", "threshold", "threads", "repeat", *NUMBERS]
    rows = [[f.name, f.terrain, f.metric, "%g" % f.threshold, str(f.threads), str(f.repeat), *(cell("%.10g", f.of(key)) for key in NUMBERS)]
            for f in flights]
    return Table("runs", "", "", header, rows).csv()


# ---- views: cameras at rest ----


def times(mesh: Json, key: str) -> list[float]:
    return list(mesh["times"].get(key, []))


def march_times(view: Json, key: str) -> list[float]:
    """All of them: the ray march is the same for every mesh of a view."""
    return [v for mesh in view["meshes"] for v in times(mesh, key)]


def likeness(mesh: Json, samples: int, filtered: bool, which: str, where: str) -> float:
    """SSIM of the picture with so many samples a pixel."""
    found = next((p for p in mesh["pictures"] if p["samples"] == samples and p["filtered"] == filtered), None)
    return number(found[which], where) if found else math.nan


Cell = Callable[[Json, Json], str]  # of a view and one of its meshes


def view_table(name: str, title: str, note: str, views: list[Json], columns: list[tuple[str, Cell]]) -> Table:
    table = Table(name, title, note, ["view", "refined", "triangles", *(heading for heading, _ in columns)])
    for view in views:
        for mesh in view["meshes"]:
            first = [f"{view['terrain']} {view['view']}", f"{mesh['metric']} {mesh['threshold']:g}",
                     f"{mesh['triangles']:.0f}" + ("" if mesh["settled"] else " (still refining)")]
            table.rows.append([*first, *(value(view, mesh) for _, value in columns)])
    return table


def view_tables(views: list[Json]) -> list[Table]:
    if not views:
        return []

    def like(which: str) -> Cell:
        return lambda _, mesh: cell("%.4f", likeness(mesh, 1, True, which, "ssim"))

    def both(samples: int, filtered: bool, which: str) -> Cell:
        def value(_: Json, mesh: Json) -> str:
            terrain = cell("%.4f", likeness(mesh, samples, filtered, which, "terrain"))
            return cell("%.4f", likeness(mesh, samples, filtered, which, "ssim")) + (f" ({terrain})" if terrain else "")

        return value

    def own(key: str) -> Cell:
        return lambda _, mesh: cell("%.0f", median(times(mesh, key)))

    def march(key: str) -> Cell:
        return lambda view, _: cell("%.0f", median(march_times(view, key)))

    def spread(values: list[float]) -> str:
        return "%.0f" % ((max(values) - min(values)) / 2) if values else ""

    def against(form: str, key: str, march_key: str, inverse: bool) -> Cell:
        def value(view: Json, mesh: Json) -> str:
            a, b = median(times(mesh, key)), median(march_times(view, march_key))
            return cell(form, ratio(b, a) if inverse else ratio(a, b))

        return value

    def pixels(key: str) -> Cell:
        return lambda _, mesh: cell("%.3f", number(mesh[key], "median")) + " / " + cell("%.2f", number(mesh[key], "p99"))

    def lacks(key: str) -> Cell:
        return lambda _, mesh: cell("%.4f", number(mesh["missing"], key))

    def step(k: int) -> Cell:
        return lambda _, mesh: cell("%.4f", number(mesh["correction"][k], "ssim"))

    samples = sorted({p["samples"] for view in views for mesh in view["meshes"] for p in mesh["pictures"]})
    corrections = views[0]["meshes"][0]["correction"]
    return [
        view_table(
            "likeness", "Likeness of the settled mesh",
            "SSIM of settled meshes, as they are and corrected onto the true surface, against the converged ray march of the same camera; "
            "in brackets: windows that see terrain alone. Filtered: both are shaded by each sample's footprint.",
            views,
            [(f"{'filtered' if filtered else 'unfiltered'}, {math.isqrt(n)}x{math.isqrt(n)}: {which}", both(n, filtered, which))
             for filtered in (True, False) for n in samples for which in ("mesh", "corrected")]),
        view_table(
            "missing", "Sources of error",
            "1 - SSIM, filtered, one sample, and its parts. Silhouettes: windows where mesh and march see different ground. In the other "
            "windows, geometry is what disappears when every sample of the mesh is moved onto the true surface, and shading is what "
            "remains (equal ground, different colours). Marcher: the ray march against one with half its steps.",
            views,
            [("1 - SSIM", lacks("total")), *((key, lacks(key)) for key in ("silhouettes", "geometry", "shading", "marcher")),
             ("windows at silhouettes", lambda _, mesh: cell("%.1f %%", 100 * number(mesh["missing"], "silhouette_windows")))]),
        view_table(
            "speed", "Mesh against ray march: time of a picture",
            "Filtered, one sample, drawn in turn in one run; medians and half the range. Both shade every sample alike; the ray march is "
            "the converged reference. CPU: time of all threads of the process, independent of other programs; on a software driver this "
            "is the cost.",
            views,
            [("SSIM", like("mesh")), ("mesh ms", own("mesh_ms")), ("spread", lambda _, mesh: spread(times(mesh, "mesh_ms"))),
             ("ray march ms", march("march_ms")), ("spread", lambda view, _: spread(march_times(view, "march_ms"))),
             ("faster by", against("%.1f", "mesh_ms", "march_ms", True)), ("mesh CPU ms", own("mesh_cpu_ms")),
             ("ray march CPU ms", march("march_cpu_ms")), ("faster by CPU", against("%.1f", "mesh_cpu_ms", "march_cpu_ms", True))]),
        view_table(
            "corrected", "The mesh corrected along each ray: likeness and cost",
            "Three heights a sample move the mesh's samples onto the true surface (window and page show it so: it hides the mesh's "
            "errors). Filtered, one sample; drawn in turn in one run, medians.",
            views,
            [("SSIM mesh", like("mesh")), ("SSIM corrected", like("corrected")), ("mesh ms", own("mesh_ms")),
             ("corrected ms", own("corrected_ms")), ("ray march ms", march("march_ms")),
             ("cost, of the march", against("%.3f", "corrected_ms", "march_ms", False)),
             ("of its CPU time", against("%.3f", "corrected_cpu_ms", "march_cpu_ms", False)),
             ("off by, mesh: median / p99 px", pixels("pixel_error")),
             ("corrected: median / p99 px", pixels("pixel_error_corrected"))]),
        view_table(
            "steps", "The correction by its steps", "One height for each step and sample. SSIM, filtered, one sample.", views,
            [("mesh alone", like("mesh")),
             *((f"{c['steps']} step" + ("" if c["steps"] == 1 else "s"), step(k)) for k, c in enumerate(corrections))]),
    ]


# ---- what is required ----

MOST_TRIANGLES = 500_000
LIKE, LIKE_WHERE_STEEP, LIKE_UNFILTERED, LIKE_FLYING = 0.97, 0.95, 0.95, 0.92
FASTER, LIKE_WHEN_FASTER = 8, 0.95  # on a software driver
POPPING = 1 / 3


def targets_of(views: list[Json], flights: list[Flight]) -> Table:
    table = Table(
        "targets", "Required and measured",
        "The worst case of each. Cameras at rest: the settled mesh with the most triangles up to 500,000. Flights: refined by area. Speed "
        "is required on Mesa's software driver.",
        ["what", "required", "measured", "where", "met"])

    def require(what: str, form: str, least: bool, required: float, measured: Iterable[tuple[float, str]]) -> None:
        """The worst of what was measured; nothing: no row."""
        worst = [(v, where) for v, where in measured if not math.isnan(v)]
        if not worst:
            return
        value, where = (min if least else max)(worst, key=lambda one: one[0])
        met = value >= required if least else value <= required
        table.rows.append([what, ("at least " if least else "at most ") + form % required, form % value, where, "yes" if met else "no"])

    terrains = list(dict.fromkeys([*(view["terrain"] for view in views), *(f.terrain for f in flights)]))

    def finest(view: Json) -> Json | None:
        allowed = [mesh for mesh in view["meshes"] if mesh["triangles"] <= MOST_TRIANGLES]
        return max(allowed, key=lambda mesh: number(mesh, "triangles")) if allowed else None

    def at_rest(terrain: str, samples: int, filtered: bool, required: float, what: str) -> None:
        meshes = [(view, finest(view)) for view in views if view["terrain"] == terrain]
        for where, words in (("ssim", ""), ("terrain", ", terrain alone")):
            require(f"{terrain}, {what}{words}", "%.3f", True, required,
                    [(likeness(mesh, samples, filtered, "mesh", where), view["view"]) for view, mesh in meshes if mesh])

    for terrain in terrains:
        at_rest(terrain, 4, True, LIKE_WHERE_STEEP if terrain == "canyon" else LIKE, "camera at rest, filtered, 2x2 samples")
    for terrain in terrains:
        at_rest(terrain, 16, False, LIKE_UNFILTERED, "camera at rest, unfiltered, 4x4 samples")
    for f in flights:
        for key, words in (("ssim_mean", ""), ("ssim_mean_terrain", ", terrain alone")) if f.metric == "area" else ():
            require(f"{f.terrain}, along the flight at 50 m/s{words}", "%.3f", True, LIKE_FLYING,
                    [(f.of(key), f"mean of {f.of('frames'):.0f} pictures")])
    fast = [(view, mesh) for view in views for mesh in view["meshes"] if not likeness(mesh, 1, True, "mesh", "ssim") < LIKE_WHEN_FASTER]
    for what, march, own in (("a picture of the mesh, faster than ray marching where SSIM is at least 0.95", "march_ms", "mesh_ms"),
                             ("the same, by CPU time", "march_cpu_ms", "mesh_cpu_ms")):
        require(what, "%.1f", True, FASTER,
                [(ratio(median(march_times(view, march)), median(times(mesh, own))), f"{view['terrain']} {view['view']}")
                 for view, mesh in fast])
    require("largest change between frames while a mesh refines, with morphing as a share of without", "%.3f", False, POPPING,
            [(ratio(f.of("popping_on"), f.of("popping_off")), f.terrain) for f in flights])
    differed = [(f.of("hash_mismatches"), f.name) for f in flights]
    require("iterations after which a client's mesh differed from the server's", "%.0f", False, 0,
            differed if any(v for v, _ in differed) else [(v, "all flights") for v, _ in differed])
    return table


# ---- plots ----

# Okabe and Ito's, told apart by colour-blind eyes.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
Lines = dict[str, tuple[list[float], list[float]]]


def numbered(values: list[float]) -> tuple[list[float], list[float]]:
    return [k + 1.0 for k in range(len(values))], values


def plot(title: str, x: str, y: str, lines: Lines, lowest: float = 0) -> str:
    figure = Figure(figsize=(8.5, 4))
    axes = figure.add_axes((0.09, 0.14, 0.62, 0.76))
    for k, (name, (xs, ys)) in enumerate(sorted(lines.items())):
        axes.plot(xs, ys, label=name, color=COLOURS[k % len(COLOURS)], linestyle="-" if k < len(COLOURS) else "--", linewidth=1.5)
    axes.set(title=title, xlabel=x, ylabel=y)
    axes.set_xlim(left=0)
    axes.set_ylim(bottom=lowest)
    axes.yaxis.grid(True, color="#ddd")
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(loc="upper left", bbox_to_anchor=(1.02, 1), frameon=False, fontsize="small")
    out = io.StringIO()
    figure.savefig(out, format="svg", metadata={"Date": None})
    return out.getvalue()[out.getvalue().index("<svg"):]


def plots_of(flights: list[Flight]) -> dict[str, str]:
    """By their files' names."""
    if not flights:
        return {}
    finest: dict[tuple[str, str], Flight] = {}  # with pictures, over each terrain by each metric
    for f in flights:
        known = finest.get((f.terrain, f.metric))
        if f.like and (known is None or f.threshold < known.threshold):
            finest[f.terrain, f.metric] = f
    named = {f"{f.terrain} {f.metric} {f.threshold:g}": f for f in finest.values()}
    triangles: Lines = {}
    received: Lines = {}
    distribution: Lines = {}
    along: Lines = {}
    for name, f in named.items():
        triangles[name] = numbered(f.each("triangles_held"))
        received[name] = numbered(list(accumulate(v / 1e6 for v in f.each("bytes"))))
        if len(f.like) > 1:
            distribution[name] = [k / (len(f.like) - 1) for k in range(len(f.like))], sorted(f.like)
        at = f.summary["frames_t"]
        along[name] = at[: len(f.like)], f.like[: len(at)]
    popping: Lines = {}
    for f in flights:
        for which, changes in f.summary.get("popping_frames", {}).items():
            popping[f"{f.terrain}, morphing {which}"] = [k / 60 for k in range(len(changes))], changes
    stages: Lines = {stage: numbered(flights[0].each(f"{stage}_ms")) for stage in STAGES}
    lowest = math.floor(20 * min((v for f in named.values() for v in f.like), default=1)) / 20
    out = {
        "triangles.svg": plot("Triangles held", "iteration", "triangles", triangles),
        "bytes.svg": plot("Received", "iteration", "megabytes", received),
        "stages.svg": plot(f"Time of each stage, {flights[0].setting}", "iteration", "milliseconds", stages),
    }
    if distribution:
        out["likeness.svg"] = plot("SSIM along the flights: distribution", "share of the pictures below", "SSIM", distribution, lowest)
    if along:
        out["likeness-along.svg"] = plot("SSIM along the flights", "seconds of the path", "SSIM", along, lowest)
    if popping:
        out["popping.svg"] = plot("Change from frame to frame, standing camera", "seconds", "1 - SSIM", popping)
    return out


# ---- the page and the document ----

STYLE = """body{font:15px/1.45 sans-serif;max-width:1240px;margin:2em auto;padding:0 1em;color:#222}
table{border-collapse:collapse;font-size:13px}td,th{border:1px solid #ccc;padding:3px 7px;text-align:right}
th{background:#f3f3f3;vertical-align:bottom}td:first-child,th:first-child{text-align:left;white-space:nowrap}
tr:nth-child(odd) td{background:#fafafa}img{max-width:100%;width:100%;height:auto}
figure{display:inline-block;width:48%;margin:.5%;vertical-align:top}figcaption{font-size:12px;color:#555}
.wide{overflow-x:auto}h2{margin-top:2em}"""
ROWS = "Each row below is a lock-step flight with its own server. Repeated flights: median ± half the range."


def picture(file: Path, caption: str) -> str:
    """At most 640 pixels across, for the page; empty where there is none."""
    if not file.exists():
        return ""
    with Image.open(file) as image:
        n = 1
        while image.width / n > 640 and image.width % (2 * n) == 0 and image.height % (2 * n) == 0:
            n *= 2
        out = io.BytesIO()
        image.convert("RGB").reduce(n).save(out, "JPEG", quality=88)
    words, data = html.escape(caption), base64.b64encode(out.getvalue()).decode()
    return f'<figure><img alt="{words}" src="data:image/jpeg;base64,{data}"><figcaption>{words}</figcaption></figure>\n'


def least_like(f: Flight) -> str:
    """The picture of a flight that is least like the ray march, beside the march."""
    if not f.like:
        return ""
    k = min(range(len(f.like)), key=lambda at: f.like[at])
    name, where = f.summary["frames_names"][k], f"{f.terrain}, {f.metric} {f.threshold:g}, after {f.summary['frames_t'][k]:.1f} s: "
    return (picture(f.folder / f"{name}-mesh.png", f"{where}mesh, SSIM {f.like[k]:.3f}")
            + picture(f.folder / f"{name}-raymarch.png", f"{where}ray march"))


def page(machine: str, targets: Table, of_views: list[Table], of_flights: list[Table], views: list[Path], flights: list[Flight],
         plots: dict[str, str]) -> str:
    out = [f"""<!doctype html><html lang="en"><meta charset="utf-8"><meta name="viewport" content="width=device-width">
<title>Ridgecast: mesh against ray march</title>
<style>{STYLE}</style>
<h1>Mesh against ray march</h1>
<p>{html.escape(machine)}</p>
"""]
    if targets.rows:
        out.append(targets.html())
    if of_views:
        out += ["<h2>Cameras at rest, settled meshes</h2>\n", *(table.html() for table in of_views), "<h3>Pictures</h3>\n"]
        out += [picture(view / file, f"{view.name}: {what}") for view in views
                for file, what in (("mesh.png", "mesh"), ("march.png", "ray march"), ("corrected.png", "mesh, corrected"),
                                   ("loss.png", "1 - SSIM of the mesh: black 0, white 0.25 and more"))]
    if of_flights:
        out += [f"<h2>Flights</h2>\n<p>{ROWS}</p>\n", *(table.html() for table in of_flights), "<h3>Plots</h3>\n"]
        out += [f'<figure><img alt="{name}" src="data:image/svg+xml;base64,{base64.b64encode(svg.encode()).decode()}"></figure>\n'
                for name, svg in plots.items()]
        out += ["<h3>Pictures</h3>\n<p>For each flight, the picture least like the ray march.</p>\n", *map(least_like, flights)]
    return "".join(out) + "</html>\n"


def document(machine: str, targets: Table, of_views: list[Table], of_flights: list[Table]) -> str:
    out = [f"# Mesh against ray march\n\nWritten by `ridgecast-client evaluate`: {machine}.\n\n"]
    out += [targets.markdown()] if targets.rows else []
    out += [table.markdown() for table in of_views]
    out += [ROWS + "\n\n"] if of_flights else []
    return "".join([*out, *(table.markdown() for table in of_flights)]).rstrip("\n") + "\n"


# ---- what is there ----


def read(file: Path, what_to_do: str) -> Json:
    try:
        out = json.loads(file.read_text())
        if isinstance(out, dict):
            return out
    except (OSError, ValueError):
        pass
    sys.exit(f"{file} is broken; {what_to_do}")


def others_of(folder: Path) -> float:
    """The share of the machine that other programs took while what is in the folder was measured."""
    try:
        return number(json.loads((folder / "machine.json").read_text()), "others")
    except (OSError, ValueError):
        return math.nan


def others_in(folders: list[Path]) -> str:
    shares = [100 * v for v in map(others_of, folders) if not math.isnan(v)]
    if not shares:
        return ""
    return f"; CPU share of other programs meanwhile {min(shares):.0f} to {max(shares):.0f} %, median {median(shares):.0f} %"


def write_report(folder: Path) -> None:
    parts = read(folder / "parts.json", "run ridgecast-client evaluate --report again")
    folders = [folder / view for view in parts["views"]]
    views = [read(view / "view.json", "remove its folder to measure it again") for view in folders]
    flights = [Flight(run, folder) for run in parts["flights"]]
    machine = parts["machine"] + others_in([*folders, *(f.folder for f in flights)])
    targets, of_views, of_flights, plots = targets_of(views, flights), view_tables(views), flight_tables(flights), plots_of(flights)
    files = {"report.md": document(machine, targets, of_views, of_flights),
             "report.html": page(machine, targets, of_views, of_flights, folders, flights, plots), "targets.csv": targets.csv(), **plots}
    if flights:
        files["runs.csv"] = runs_csv(flights)
    files.update({f"{table.name}.csv": table.csv() for table in [*of_views, *of_flights]})
    for name, text in files.items():
        (folder / name).write_text(text, newline="")


def main() -> None:
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent
    matplotlib.rcParams.update({"svg.fonttype": "none", "font.family": "sans-serif"})
    try:
        write_report(folder)
    except (KeyError, TypeError, IndexError) as error:
        sys.exit(f"{folder} holds results of another version ({error!r}): choose another --out")
    except OSError as error:
        sys.exit(f"cannot write {error.filename}: {error.strerror}; choose a folder that may be written and has room")


if __name__ == "__main__":
    main()
