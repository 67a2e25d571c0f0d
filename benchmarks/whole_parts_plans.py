"""Parts of the whole measurement: commands, plans, tours, schedules, diagnosis, libraries, and
how the house stands.
"""

import math

from whole_figures import (
    EXACT,
    Figure,
    Output,
    Part,
    Read,
    at,
    counted,
    every,
    mean,
    median,
    of,
    said,
    share,
    where,
)

TSPLIB = ("d1655", "fl1400", "fl3795", "pcb1173", "pcb3038", "pr1002", "rl1889", "u2152", "vm1748")


def solved(planner: str) -> Read:
    """How many tasks a planner has solved."""
    return counted(lambda row: row["steps"] is not None, where("planner", planner))


def of_lama(output: Output) -> float | None:
    """The summed cost of plans in parts of that of `lama`, on tasks that both solve."""
    both = [(row["ours"], row["lama"]) for row in output.kept if row["ours"] and row["lama"]]
    return sum(one for one, _ in both) / sum(other for _, other in both) if both else None


def beside(one: str, other: str) -> Read:
    """The geometric mean of the times of one planner to those of another, on tasks that both
    solve.
    """

    def read(output: Output) -> float | None:
        times = {
            (r["task"], r["planner"]): r["seconds"] for r in output.kept if r["steps"] is not None
        }
        ratios = [
            math.log(taken / times[task, other])
            for (task, planner), taken in times.items()
            if planner == one and (task, other) in times
        ]
        return math.exp(mean(ratios)) if ratios else None

    return read


def row_s(problem: str, key: str) -> Read:
    """A time of a bundled problem."""
    return of(lambda kept: [each for each in kept["rows"] if each["problem"] == problem], key)


def stages_s(points: int) -> Read:
    """Seconds of the processor of all commands for a part with so many points."""

    def read(output: Output) -> float | None:
        rows = [row for row in output.kept if row["points"] == points]
        return sum(each["cpu_s"] for each in rows[0]["stages"].values()) if rows else None

    return read


def peak_mb(points: int) -> Read:
    """The largest process of those commands."""
    return lambda output: max(
        each["peak_mb"]
        for row in output.kept
        if row["points"] == points
        for each in row["stages"].values()
    )


def one_point(points: int) -> Read:
    """Seconds of the processor to plan one point in a cell with so many."""
    return of(lambda kept: [row["one"] for row in kept if row["points"] == points], "cpu_s")


def gap(key: str) -> Read:
    """The mean of a gap over all instances that have it."""
    return of(lambda kept: kept["rows"], key, mean)


PEERS = ("--peers={peers}",)
LARGE = ("--only", *TSPLIB)
PLANS = (
    Part(
        "start", "benchmarks/start.py", ("--runs", "2", "--json", "{json}"), ("--runs", "5", "--json", "{json}"),
        (
            Figure(27, "start-up of `cellwright --help`", at(""), "s", 0.3),
            Figure(27, "start-up of the slowest command", lambda o: max(o.kept.values()), "s", 0.6),
            Figure(27, "start-up of all commands, "
            "mean", lambda o: mean(list(o.kept.values())), "s"),
        ),
        (12, 8),
    ),
    Part(
        "plan", "benchmarks/plan.py", ("--runs", "2", "--json", "{json}"), ("--runs", "5", "--json", "{json}"),
        (
            Figure(14, "search of "
            "bulkhead/one_point", row_s("bulkhead/one_point", "search"), "s", 0.2),
            Figure(14, "search of "
            "bulkhead/twelve_points", row_s("bulkhead/twelve_points", "search"), "s", 2.0),
            Figure(14, "search of themse/one", row_s("themse/one", "search"), "s", 0.2),
            Figure(14, "search of themse/four", row_s("themse/four", "search"), "s", 2.0),
            Figure(14, "whole command, "
            "bulkhead/one_point", row_s("bulkhead/one_point", "command"), "s"),
            Figure(15, "steps of all bundled "
            "plans", of(lambda k: k["rows"], "steps", sum), "", noise=EXACT),
            Figure(24, "search of eight tubes", row_s("centrifuge/eight", "search"), "s", 1.0),
        ),
        (15, 15),
    ),
    Part(
        "planning", "benchmarks/planning.py",
        ("--levels", "1-2", "--seconds", "10", "--planners", "auto", *PEERS, "--json", "{json}"),
        ("--levels", "1-5", "--seconds", "60", *PEERS, "--json", "{json}"),
        (
            Figure(24, "competition tasks "
            "solved", solved("auto"), "", less=False, noise=EXACT, peer=("lama-first", solved("lama-first"))),
            Figure(24, "time beside lama-first, geometric "
            "mean", beside("auto", "lama-first"), "", 1.0, peer=("pyperplan", beside("pyperplan", "lama-first"))),
        ),
        (18, 180),
    ),
    Part(
        "checking", "benchmarks/checking.py",
        ("--levels", "1-2", "--seconds", "10", "--runs", "1", "--json", "{json}"),
        ("--levels", "1-5", "--json", "{json}"),
        (Figure(24, "plans checked in 50 ms or a tenth of "
        "planning", share(lambda row: row["met"]), "%", 100.0, less=False),),
        (6, 120),
    ),
    Part(
        "anytime", "benchmarks/anytime.py",
        ("--levels", "1", "--seconds", "3", *PEERS, "--json", "{json}"),
        ("--levels", "1-4", "--seconds", "30", *PEERS, "--json", "{json}"),
        (Figure(24, "cost of plans beside lama, same time", of_lama, "", 0.95, noise=EXACT),),
        (4, 60),
    ),
    Part(
        "numeric", "benchmarks/planning.py",
        ("--numeric", "--seconds", "10", "--only", "counters", "--planners", "auto", *PEERS, "--beside", "enhsp", "--json", "{json}"),
        ("--numeric", "--seconds", "60", "--planners", "auto", *PEERS, "--beside", "enhsp", "--json", "{json}"),
        (Figure(24, "numeric tasks "
        "solved", solved("auto"), "", less=False, noise=EXACT, peer=("ENHSP", solved("enhsp"))),),
        (6, 120),
    ),
    Part(
        "thousand", "benchmarks/thousand.py", ("--points", "10", "100", "1000", "--json", "{json}"),
        ("--points", "10", "100", "1000", "10000", "--json", "{json}"),
        (
            Figure(16, "100 points, all commands", stages_s(100), "s of the processor"),
            Figure(16, "one point in a cell with 100", one_point(100), "s of the processor", 0.3),
            Figure(16, "1,000 points, all commands", stages_s(1000), "s of the processor", 20.0),
            Figure(16, "1,000 points, peak memory", peak_mb(1000), "MB", 700.0, noise=0.1),
            Figure(16, "one point in a cell with "
            "1,000", one_point(1000), "s of the processor", 0.3),
            Figure(16, "10,000 points, all commands", stages_s(10000), "s of the processor", 300.0),
            Figure(16, "10,000 points, peak memory", peak_mb(10000), "MB", 3000.0, noise=0.1),
        ),
        (9, 60),
    ),
    Part(
        "sequencing", "benchmarks/sequencing.py", ("--seconds", "1", "--only", "pr1002", "berlin52", "--peers", "--json", "{json}"),
        ("--seconds", "1", "10", "--peers", "--json", "{json}"),
        (
            Figure(16, "gap of tours after 1 s, "
            "mean", gap("ours 1 s %"), "%", 1.0, peer=("OR-Tools routing", gap("routing 1 s %"))),
            Figure(16, "gap of tours after 10 s, mean, 700 to 5,000 "
            "cities", of(lambda k: [r for r in k["rows"] if 700 <= r["n"] <= 5000], "ours 10 s "
            "%", mean), "%", 0.15, peer=("OR-Tools routing", gap("routing 10 s %"))),
            Figure(16, "gap of tours after 10 s, "
            "worst", of(lambda k: [r for r in k["rows"] if 700 <= r["n"] <= 5000], "ours 10 s "
            "%"), "%", 0.4),
        ),
        (9, 60),
    ),
    Part(
        "clustered", "benchmarks/sequencing.py", ("--seconds", "10", "--only", "fl1400", "--json", "{json}"), ("--seconds", "10", "--only", "fl1400", "fl3795", "--json", "{json}"),
        (Figure(16, "bound below the optimum, clustered cities, "
        "worst", of(lambda k: k["rows"], "bound %"), "%", 2.0),), (6, 10),
    ),
    Part(
        "scattered", "benchmarks/sequencing.py", ("--only", "berlin52", "--seconds", "1", "--random", "100000", "--json", "{json}"), ("--only", "berlin52", "--seconds", "1", "--random", "100000", "--json", "{json}"),
        (Figure(16, "100,000 random cities above the "
        "constant", of(lambda k: k["rows"], "ours 60 s %"), "%", 5.0),), (6, 15),
    ),
    Part(
        "scheduling", "benchmarks/scheduling.py", ("--seconds", "5", "--only", "4 "
        "probes", "--json", "{json}"),
        ("--seconds", "30", "--json", "{json}"),
        (
            Figure(15, "schedules that miss a "
            "bar", counted(lambda r: bool(r["missed"])), "", 0.0, noise=EXACT),
            Figure(15, "gap of schedules, "
            "worst", lambda o: max(100 * (r["makespan"] / max(1, r["bound"]) - 1) for r in o.kept if r["makespan"]), "%"),
        ),
        (12, 40),
    ),
    Part(
        "plates", "benchmarks/plates.py",
        ("--plates", "8", "24", "--elisa", "3", "--readers", "--json", "{json}"),
        ("--json", "{json}"),
        (
            Figure(47, "days with plates that miss a "
            "bar", counted(lambda r: bool(r["missed"])), "", 0.0, noise=EXACT),
            Figure(47, "gap of screening days, "
            "worst", lambda o: max(100 * (r["makespan"] / max(1, r["bound"]) - 1) for r in o.kept if "screening" in r["day"]), "%", 15.0),
        ),
        (1, 40),
    ),
    Part(
        "diagnosis", "benchmarks/diagnosis.py",
        ("--problems", "20", "--part", "exact", "sparse", "noisy", "setup", "circuits", "advice", "bases", "--json", "{json}"),
        ("--json", "{json}"),
        (
            Figure(15, "optimal tests, 20 x 20, "
            "worst", of(where("causes x tests", "20 x 20", "exact"), "worst (s)"), "s", 1.0),
            Figure(15, "optimal tests, 30 x 30, "
            "worst", of(where("causes x tests", "30 x 30", "exact"), "worst (s)"), "s", 10.0),
            Figure(15, "rollout dearer than the optimum, sparse, "
            "mean", of(where("rule", "rollout", "sparse"), "mean loss (%)"), "%", 0.5),
            Figure(15, "rollout dearer than the optimum, uncertain, "
            "mean", of(where("rule", "rollout", "noisy"), "mean loss (%)"), "%", 0.5),
            Figure(15, "bars of diagnosis "
            "missed", lambda o: float(len(o.kept["missed"])), "", 0.0, noise=EXACT),
        ),
        (12, 40),
    ),
    Part(
        "macros", "benchmarks/macros.py", ("--macrops", "200", "--points", "60", "--json", "{json}"),
        ("--json", "{json}"),
        (
            Figure(14, "lookup of a MACROP, "
            "median", of(where("queries", "figure 4", "lookup"), "median_ms"), "ms", 2.0),
            Figure(14, "hits in a sequence of a thousand "
            "points", lambda o: 100 * o.kept["sequence"]["hits"] / o.kept["sequence"]["points"], "%", 99.0, less=False),
        ),
        (9, 60),
    ),
    Part(
        "reuse", "benchmarks/reuse.py", ("--part", "revision", "--each", "2", "--json", "{json}"), ("--json", "{json}"),
        (
            Figure(15, "revising beside planning anew, "
            "median", lambda o: median([r["revising_s"] / r["scratch_s"] for r in o.kept["revision"]]), "", 1.0),
            Figure(15, "cost of revised plans beside fresh "
            "ones", lambda o: sum(r["cost"] for r in o.kept["revision"]) / sum(r["fresh_cost"] for r in o.kept["revision"]), "", 1.05, noise=0.02),
        ),
        (9, 60),
    ),
    Part(
        "scale", "benchmarks/scale.py", ("--macrops", "50", "--copies", "1000", "--json", "{json}"), ("--json", "{json}"),
        (), (9, 20),
    ),
    Part(
        "clients", "benchmarks/clients.py", ("--clients", "10", "--seconds", "60", "--macrops", "100", "--points", "60", "--json", "{json}"), ("--json", "{json}"),
        (
            Figure(26, "lookup in a shared library, 99th percentile", at("p99_ms"), "ms", 20.0),
            Figure(26, "updates lost in a shared "
            "library", lambda o: float(len(o.kept["wrong"])), "", 0.0, noise=EXACT),
        ),
        (6, 20),
    ),
    Part(
        "cluster", "benchmarks/cluster.py", ("--problems", "8", "--pairs", "1", "--kills", "1", "--json", "{json}"), ("--json", "{json}"),
        (
            Figure(26, "preparation with two processes, times as fast, "
            "median", lambda o: median([r["one"]["clock_s"] / r["two"]["clock_s"] for r in o.kept["speed"]]), "", 1.8, less=False),
            Figure(26, "stores that differ after "
            "kills", lambda o: float(sum(bool(r["wrong"]) for r in o.kept["mishaps"])), "", 0.0, noise=EXACT),
        ),
        (6, 120),
    ),
    Part(
        "stores", "benchmarks/stores.py", ("--only", "sqlite", "--kills", "8", "--full", "4", "--damage", "30", "--writers", "3", "--json", "{json}"), ("--json", "{json}"),
        (
            Figure(23, "mishaps of libraries "
            "tried", of(every, "trials", sum), "", less=False, noise=EXACT),
            Figure(23, "mishaps of libraries that went "
            "wrong", lambda o: float(sum(len(r["wrong"]) for r in o.kept)), "", 0.0, noise=EXACT),
        ),
        (9, 90),
    ),
    Part(
        "limits", "benchmarks/limits.py", ("--seconds", "2", "--times", "1", "--part", "time", "--only", "plan", "--json", "{json}"), ("--json", "{json}"),
        (
            Figure(23, "limits and interruptions "
            "kept", share(lambda r: not r["wrong"]), "%", 100.0, less=False, noise=EXACT),
            Figure(23, "limits and interruptions "
            "tried", lambda o: float(len(o.kept)), "", less=False, noise=EXACT),
        ),
        (9, 60),
    ),
    Part(
        "fuzz", "tests/fuzzing/campaign.py", ("--minutes", "1", "--seed", "1"), ("--minutes", "10", "--seed", "1"),
        (
            Figure(23, "mutated inputs tried", said(r"\| all \| (\d+)"), "", less=False, noise=1.0),
            Figure(23, "exceptions that no reader "
            "promises", said(r"\| all \| \d+ \| \d+ \| \d+ \| (\d+)"), "", 0.0, noise=EXACT),
            Figure(23, "slowest "
            "case", said(r"\| all \|.* (\d+\.\d+) \| \d+ \|"), "s of the "
            "processor", 20.0, noise=1.0),
        ),
        (6, 15),
    ),
    Part(
        "mutation", "benchmarks/mutation.py", ("--mutators={peers}", "--seed", "2", "--count", "12", "--json", "{json}"), ("--mutators={peers}", "--seed", "2", "--count", "600", "--json", "{json}"),
        (Figure(14, "mutants that tests "
        "notice", share(lambda m: m["became"] != "survived", lambda kept: kept["mutants"]), "%", 85.0, less=False, noise=0.02),),
        (6, 240),
    ),
)  # fmt: skip
