"""Parts of the whole measurement: contact states, geometry, motion, placing, inspection,
execution, the monitor, editors, two arms.
"""

from whole_figures import (
    EXACT,
    Figure,
    Output,
    Part,
    Read,
    at,
    counted,
    of,
    quantile,
    said,
    share,
    where,
)
from whole_figures import median as middle

UR5 = ("ompl",)


def solved(rows: object) -> list[dict[str, float]]:
    """The rows of problems that were solved."""
    return [row for row in rows if row["status"] == "solved"]  # type: ignore[attr-defined]


def last(kept: str, unit: str = "resume from") -> Read:
    """The first figure of a benchmark whose name begins so."""

    def read(output: Output) -> float | None:
        return next(
            (float(v) for k, v in output.kept.items() if k.startswith(unit) and k.endswith(kept)),
            None,
        )

    return read


def ratio(own: str, other: str) -> Read:
    """The least ratio of our rate in batches to that of another backend, over all cells."""

    def read(output: Output) -> float | None:
        found = []
        for cell in output.kept:
            ours = max(each["batch"] for each in cell["rows"] if each["backend"].startswith(own))
            found += [
                ours / each["batch"] for each in cell["rows"] if each["backend"].startswith(other)
            ]
        return min(found) if found else None

    return read


def beside(row: str, key: str) -> Read:
    """A number of a fit beside a peer's; None where the peer is not installed."""

    def read(output: Output) -> float | None:
        value = output.kept["1"]["patches"]["peers"].get(row, {}).get(key)
        return None if value is None else float(value)

    return read


def pegs(how: str) -> Read:
    """The share of pegs that one way of placing has brought into their holes, in per cent."""

    def read(output: Output) -> float | None:
        row = output.kept["pegs"]
        return 100.0 * row.get(how, 0) / row["pegs"]

    return read


def localised(key: str) -> Read:
    """A share of the parts that are there, in per cent."""

    def read(output: Output) -> float | None:
        row = output.kept["localisation"]
        there = sum(row.get(each, 0) for each in ("right", "wrong", "not found, is there"))
        return 100.0 * row.get(key, 0) / there

    return read


CELLS = (
    Part(
        "states", "benchmarks/states.py", ("1", "4", "8", "16"), ("1", "2", "4", "8", "16"),
        (
            Figure(17, "net of eight "
            "probes", said(r"(?m)^ +8 .*? (\d+\.\d+) +\d+\.\d+  "), "s of the processor", 1.0),
            Figure(17, "net of sixteen "
            "probes", said(r"(?m)^ +16 .*? (\d+\.\d+) +\d+\.\d+  "), "s of the processor", 1.0),
            Figure(17, "places of sixteen "
            "probes", said(r"(?m)^ +16 +(\d+)"), "", 39.0, noise=EXACT),
        ),
        (6, 5),
    ),
    Part(
        "kinematics", "benchmarks/kinematics.py", ("--poses", "500", "--json", "{json}"), ("--json", "{json}"),
        (
            Figure(18, "inverse kinematics, worst "
            "residual", of(lambda k: [r for r in k if r["solver"] != "EAIK"], "residual"), "", 1e-9, noise=9.0, peer=("EAIK", of(where("solver", "EAIK"), "residual"))),
            Figure(18, "inverse kinematics in a batch, slowest "
            "arm", of(lambda k: [r for r in k if r["solver"] != "EAIK"], "batch"), "us", peer=("EAIK", of(where("solver", "EAIK"), "batch"))),
        ),
        (6, 10), ("eaik",),
    ),
    Part(
        "collision", "benchmarks/collision.py", ("--configurations", "500", "--cells", "bookshelf_small", "--json", "{json}"), ("--json", "{json}"),
        (
            Figure(18, "collision checks beside MuJoCo, least, times as "
            "fast", ratio("builtin", "mujoco"), "", 3.0, less=False),
            Figure(18, "collision checks in batches, slowest "
            "cell", lambda o: min(max(r["batch"] for r in cell["rows"] if r["backend"].startswith("builtin")) for cell in o.kept), "1/s", less=False),
            Figure(18, "unexplained differences of collision "
            "checks", lambda o: float(sum(r["differences"].get("unexplained", 0) for cell in o.kept for r in cell["rows"])), "", 0.0, noise=EXACT),
        ),
        (9, 20), ("mujoco", "coal"),
    ),
    Part(
        "regions", "benchmarks/regions.py", ("1000",), ("1000", "3000", "10000"),
        (Figure(18, "collision checks by tree, last "
        "row", said(r"(?m)^ *\d+ +4\.0 +[\d,]+ +([\d,]+)"), "1/s", less=False),), (6, 15),
    ),
    Part(
        "motion", "benchmarks/motion.py", ("--numbers", "2", "--json", "{json}"), ("--numbers", "20", "--json", "{json}"),
        (
            Figure(18, "UR5 problems "
            "solved", share(lambda r: r["status"] == "solved", lambda k: [r for r in k if r["status"] != "refused"]), "%", 100.0, less=False, noise=EXACT),
            Figure(18, "search, "
            "median", of(solved, "search_ms", middle), "ms", 0.5, peer=("OMPL, our "
            "check", of(solved, "ompl_ms", middle))),
            Figure(18, "search, 95th "
            "percentile", of(solved, "search_ms", quantile(0.95)), "ms", 30.0, peer=("OMPL, "
            "MuJoCo's "
            "check", of(solved, "ompl_mujoco_ms", quantile(0.95)))),
            Figure(18, "with short cuts, median", of(solved, "short_ms", middle), "ms", 3.0),
            Figure(18, "with margin and proof, "
            "median", of(solved, "declared_ms", middle), "ms", 8.0),
            Figure(18, "length beside the best known, "
            "median", lambda o: middle([r["lengths"][1] / min(r["lengths"]) for r in solved(o.kept)]), "", 1.15, noise=0.02),
            Figure(18, "paths that touch "
            "something", counted(lambda r: r.get("hits", 0) > 0), "", 0.0, noise=EXACT),
        ),
        (9, 40), ("ompl", "mujoco"),
    ),
    Part(
        "certified", "benchmarks/motion.py", ("--certified", "40", "--json", "{json}"), ("--certified", "1000", "--json", "{json}"),
        (
            Figure(18, "certified paths that touch "
            "something", counted(lambda r: r.get("hits", 0) > 0), "", 0.0, noise=EXACT),
            Figure(18, "certified paths that needed no "
            "refinement", share(lambda r: not r["shorter"], lambda k: [r for r in k if r["proved"]]), "%", less=False),
            Figure(18, "proof, "
            "median", of(lambda k: [r for r in k if r["proved"]], "proof_ms", middle), "ms", 5.0),
        ),
        (6, 60),
    ),
    Part(
        "strategies", "benchmarks/motion_cells.py", ("--queries", "10", "--json", "{json}"), ("--queries", "200", "--json", "{json}"),
        (Figure(18, "queries of our cells without a path, "
        "connect", lambda o: float(sum("why" in r for cell in o.kept.values() for r in cell["connect"])), "", noise=EXACT),),
        (9, 60),
    ),
    Part(
        "blocks", "benchmarks/motion_random.py", ("--cells", "3", "--json", "{json}"), ("--cells", "25", "--json", "{json}"),
        (
            Figure(18, "queries among blocks without path or "
            "proof", counted(lambda r: r["end"] == "open"), "", noise=EXACT),
            Figure(18, "paths among blocks that touch "
            "something", counted(lambda r: r.get("hits", 0) > 0), "", 0.0, noise=EXACT),
        ),
        (6, 30), ("ompl",),
    ),
    Part(
        "travel", "benchmarks/motion_cells.py", ("--part", "travel", "--points", "1000"), ("--part", "travel", "--points", "1000"),
        (Figure(18, "travel times of 1,000 "
        "points", said(r"travel times, proved\W+([\d.]+)"), "s of the processor", 40.0),), (6, 30),
    ),
    Part(
        "poses", "benchmarks/poses.py", ("--json", "{json}"), ("--json", "{json}"),
        (
            Figure(20, "order and poses together, below tour then "
            "poses", lambda o: 100 * o.kept["rows"][-1]["below"], "%", 15.0, less=False, noise=0.02),
            Figure(20, "order and poses together, "
            "search", lambda o: o.kept["rows"][-1]["search s"], "s", 2.0),
        ),
        (6, 5),
    ),
    Part(
        "handey", "benchmarks/handey.py", ("--part", "relations", "localisation", "regrasps", "place", "monitoring", "--number", "6", "--json", "{json}"), ("--number", "200", "--json", "{json}"),
        (
            Figure(21, "parts located within 2 mm and 1 "
            "degree", localised("right"), "%", 95.0, less=False, noise=0.1),
            Figure(21, "parts found where there are "
            "none", lambda o: float(o.kept["localisation"].get("found, is not "
            "there", 0)), "", 0.0, noise=EXACT),
            Figure(21, "localisation, "
            "median", at("localisation", "median_s"), "s of the processor", 0.3),
            Figure(21, "transforms from relations, worst "
            "entry", at("relations", "worst"), "", 1e-9, noise=9.0),
            Figure(21, "PLACE, median", at("place", "median_s"), "s of the processor", 1.0),
            Figure(21, "PLACE, 95th percentile", at("place", "p95_s"), "s of the processor", 5.0),
            Figure(21, "placed in MuJoCo to within 3 "
            "mm", lambda o: 100 * o.kept["place"]["executed to within 3 "
            "mm"] / o.kept["place"]["planned"], "%", 98.0, less=False),
            Figure(21, "operators warned wrongly or not at "
            "all", lambda o: float(o.kept["monitoring"].get("wrong", 0)), "", 0.0, noise=EXACT),
        ),
        (12, 180), ("mujoco",),
    ),
    Part(
        "pegs", "benchmarks/handey.py", ("--part", "pegs", "--number", "4", "--json", "{json}"), ("--part", "pegs", "--number", "100", "--json", "{json}"),
        (
            Figure(21, "pegs placed with a spiral "
            "search", pegs("spiral"), "%", less=False, noise=0.05),
            Figure(21, "pegs placed without compliance", pegs("none"), "%", less=False, noise=0.1),
        ),
        (6, 30), ("mujoco",),
    ),
    Part(
        "inspection", "benchmarks/inspection.py", ("--patches", "200", "--alignments", "20", "--points", "100", "--json", "{json}"), ("--json", "{json}"),
        (
            Figure(25, "errors within the stated 95 "
            "%", lambda o: 100 * o.kept["1"]["patches"]["all"]["within"], "%", 94.0, less=False, noise=0.02),
            Figure(25, "bias, standard "
            "deviations", lambda o: abs(o.kept["1"]["patches"]["all"]["bias"]), "", 0.1, noise=1.0),
            Figure(25, "position of a plane, root mean square "
            "error", beside("position of a plane beside "
            "Open3D", "own "
            "um"), "um", noise=0.3, peer=("Open3D", beside("position of a plane beside "
            "Open3D", "peer um"))),
            Figure(25, "diameter of a hole, root mean square "
            "error", beside("diameter of a hole beside "
            "scikit-image", "own "
            "um"), "um", noise=0.3, peer=("scikit-image", beside("diameter of a hole beside "
            "scikit-image", "peer um"))),
            Figure(25, "alignments wrong when 0.05 mm is asked "
            "for", at("1", "alignments", "asked: wrong"), "", 0.0, noise=EXACT),
            Figure(25, "bad values not caught in the whole "
            "job", lambda o: float(sum(len(j["missed"]) for j in o.kept["jobs"])), "", 0.0, noise=EXACT),
            Figure(25, "wrong decisions in the whole "
            "job", lambda o: 100 * max(j["wrong share"] for j in o.kept["jobs"]), "%", 5.0),
            Figure(25, "features left "
            "undecided", lambda o: 100 * max(j["undecided share"] for j in o.kept["jobs"]), "%"),
            Figure(20, "the whole bulkhead, virtual "
            "duration", lambda o: max(j["hours"] for j in o.kept["jobs"]), "h", 2.4, noise=0.02),
        ),
        (12, 90),
    ),
    Part(
        "execution", "benchmarks/execution.py", ("--steps", "4000", "--json", "{json}"), ("--steps", "100000", "--json", "{json}"),
        (
            Figure(19, "events with group "
            "commit", at("events a second"), "1/s", 2000.0, less=False),
            Figure(19, "records with one sync "
            "each", at("records a second, one sync "
            "each"), "1/s", 200.0, less=False, noise=0.5, peer=("syncs that the disk "
            "allows", at("syncs a second that the disk allows"))),
            Figure(19, "resume from the whole journal", last("(s)"), "s", 5.0),
            Figure(19, "memory at the end beside half the "
            "way", lambda o: o.kept["memory at the end "
            "(MB)"] / o.kept["memory at half (MB)"], "", 1.1, noise=0.05),
        ),
        (9, 30),
    ),
    Part(
        "faults", "benchmarks/faults.py", ("--samples", "40", "--cluster={cluster}", "--json", "{json}"), ("--cluster={cluster}", "--json", "{json}"),
        (
            Figure(19, "fault runs", lambda o: float(len(o.kept)), "", less=False, noise=EXACT),
            Figure(19, "fault runs that ended "
            "wrong", counted(lambda r: bool(r[1]), lambda k: list(k.values())), "", 0.0, noise=EXACT),
        ),
        (12, 240),
    ),
    *(
        Part(
            f"faults_{second}", "benchmarks/faults.py", ("--second", second, "--samples", "8", "--json", "{json}"), ("--second", second, "--samples", "1000", "--cluster={cluster}", "--json", "{json}"),
            (Figure(19, f"runs with a second fault ({second}) that ended "
            "wrong", counted(lambda r: bool(r[1]), lambda k: list(k.values())), "", 0.0, noise=EXACT),),
            (6, 240),
        )
        for second in ("run", "recovery", "test")
    ),
    Part(
        "kills", "benchmarks/kills.py", ("--from", "2", "--to", "30", "--json", "{json}"), ("--json", "{json}"),
        (Figure(19, "kills "
        "survived", lambda o: float(len(o.kept)), "", less=False, noise=EXACT),), (9, 60),
    ),
    Part(
        "mishaps", "benchmarks/mishaps.py", ("--times", "3", "controller"), ("--times", "100"),
        (), (9, 60),
    ),
    Part(
        "stochastic", "benchmarks/stochastic.py", ("--probes", "4", "--runs", "10", "--known", "2", "--json", "{json}"), ("--json", "{json}"),
        (
            Figure(19, "makespan beside perfect "
            "knowledge", said(r'"beside perfect knowledge": ([\d.]+)'), "", 1.03, noise=0.02),
            Figure(19, "stays too long that nobody "
            "told", said(r'"of them not told": (\d+)'), "", 0.0, noise=EXACT),
        ),
        (9, 180),
    ),
    Part(
        "monitor", "benchmarks/monitor_load.py", ("--steps", "300", "--clients", "3"), (),
        (
            Figure(22, "delay of events, 95th "
            "percentile", said(r'"delay ms, 95 %": ([\d.]+)'), "ms", 300.0),
            Figure(22, "events lost or "
            "doubled", said(r'"lost or doubled": (\d+)'), "", 0.0, noise=EXACT),
        ),
        (6, 10), ("nicegui", "playwright", "httpx"),
    ),
    Part(
        "editor", "benchmarks/language_server.py", ("--edits", "100", "--rounds", "4", "--output", "{json}"), ("--output", "{json}"),
        (
            Figure(27, "answer of the language server, 95th "
            "percentile", at("latencies", "waited_ms", "all", "p95"), "ms", 100.0),
            Figure(27, "the same, of its "
            "processor", at("latencies", "processor_ms", "all", "p95"), "ms", 100.0),
            Figure(27, "random edits "
            "survived", at("random_edits", "edits"), "", less=False, noise=EXACT),
            Figure(27, "tracebacks of the language "
            "server", at("random_edits", "tracebacks"), "", 0.0, noise=EXACT),
        ),
        (9, 30), ("pygls",),
    ),
    Part(
        "two_arms", "benchmarks/dual.py", ("--points", "80", "--runs", "50", "--json", "{json}"), ("--json", "{json}"),
        (
            Figure(26, "two arms beside one, 400 points, times as "
            "fast", at("bulkhead", "speedup"), "", 1.7, less=False, noise=0.02),
            Figure(26, "THEMSE with two grippers, times as "
            "fast", at("themse", "times_as_fast"), "", less=False, noise=0.02),
            Figure(26, "THEMSE with two grippers, gap to the "
            "bound", lambda o: 100 * o.kept["themse"]["two_arms_gap"], "%", noise=0.1),
            Figure(26, "part off in MuJoCo", lambda o: 1e3 * o.kept["physics"]["off_m"], "mm", 3.0),
            Figure(26, "tilt in MuJoCo", at("physics", "tilt_deg"), "degrees", 2.0),
        ),
        (12, 90), ("mujoco",),
    ),
)  # fmt: skip
