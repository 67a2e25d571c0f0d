"""Runs whose steps take longer or shorter than forecast: stays that are too long, and makespans
beside perfect knowledge.

    python benchmarks/stochastic.py [--probes N] [--runs N] [--known N] [--work N] [--stay SECONDS]
        [--jobs N] [--json FILE]
    python benchmarks/stochastic.py --forecast --runs N [--tolerance SECONDS]

Probes are heated, cooled and stored in the laboratory; as many depots, furnace 1, freezer 2. Every
step of every run varies evenly by 20 % around its forecast. Nothing may stay in the furnace for
longer than --stay (0: no limit). A stay that was too long has to have been told as an exception.
For the first --known runs CP-SAT schedules the same plan with the durations that the run had, with
--work units of work, about seconds of one core; a run that nobody could have carried out within
--stay is not compared. Exits with 1 if a stay was too long and nobody told, if a run does not reach
its goals, or if the mean makespan is more than 3 % longer. With --json what was run is kept, and
the next call goes on behind it; --jobs runs so many at the same time.

With --forecast: how good the forecasts of starts are, of all and of those that a run shows, which
may not be off by more than --tolerance. Exits with 1 if less than 93 % or more than 97.5 % of the
starts are in their intervals, which should have 95 %.
"""

import argparse
import gc
import json
import os
import shutil
import statistics
import sys
import tempfile
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from cellwright.engine.formats.report.runs.run_display import RunStanding as Run
from cellwright.engine.model.outcome import Infeasible
from cellwright.engine.model.run_protocol import JournalRecord, RecordKind
from cellwright.engine.model.shop_scheduling import Timetable
from cellwright.engine.pipelines.execution import RunExecution, TimedOrders
from cellwright.engine.pipelines.execution.compiled_program import initial_situation
from cellwright.engine.pipelines.execution.executable_plan import ReadyPlan, first_plan
from cellwright.engine.pipelines.execution.plan_records import read_ground_atom
from cellwright.engine.pipelines.execution.run_journal import Recorder
from cellwright.engine.pipelines.planning.timetable import time_plan
from cellwright.engine.pipelines.recovery import SymbolicWorld
from cellwright.engine.pipelines.simulators import HiddenCell, Simulator
from cellwright.engine.pipelines.simulators.simulator_settings import SimulatorSettings
from cellwright.engine.stages.grounding import ground
from cellwright.engine.stages.scheduling import ScheduleLimits
from cellwright.kb.loader import bundled_domains, load_problem
from cellwright.kb.model.planning_problem import Problem

SPREAD = 0.2
SHARE = 1.03
LEAST, MOST = 0.93, 0.975  # of the starts are in intervals that should have 0.95 of them
ANY_MS, HALF_MS = 10**12, 500  # a tolerance that is never reached; half of the second that is shown


class Kept:
    """A journal in memory."""

    def __init__(self) -> None:
        self.records: list[JournalRecord] = []

    def append(self, records: Sequence[JournalRecord]) -> None:
        """Append records."""
        self.records += records


@dataclass(frozen=True)
class Line:
    """One run: how it ended, how long it took, stays that were too long, those of them that
    were told, and orders changed.
    """

    outcome: str
    makespan_s: float
    broken: int
    untold: int
    reordered: int
    work_s: float
    known_s: float = 0.0


def problem_in(folder: Path, probes: int, stay: int) -> Problem:
    """So many probes with as many depots; nothing may stay in the furnace for longer than
    `stay` s, if that is given.
    """
    home = folder / "lab"
    shutil.copytree(
        bundled_domains()["themse"], home, ignore=shutil.ignore_patterns("golden", "problems")
    )
    text = (home / "domain.yaml").read_text("utf-8")
    declared = text.replace("\nstatics:", "\nstatics:\n  longest_stay(unit, time): {}", 1)
    (home / "domain.yaml").write_text(declared, "utf-8")
    (home / "problems").mkdir()
    more = range(5, probes + 1)
    lines = ["problem: probes", "domain: .."]
    lines += [f"objects:\n  probe: [probe_5..{probes}]"] if more else []
    lines += ["statics:", "  - capacity(furnace, 1)", "  - capacity(freezer, 2)"]
    lines += [f"  - capacity(drawer, {max(4, probes)})"]
    lines += [f"  - longest_stay(furnace, {stay})"] if stay else []
    lines += [f"  - own_depot(probe_{n}, slot(drawer, {n}))" for n in more]
    lines += ["workflow:", f"  - for: {{P: [probe_1..{probes}]}}"]
    lines += ["    stages: heated(P, 15 min), cooled(P, 5 min), stored(P)"]
    (home / "problems" / "probes.yaml").write_text("\n".join(lines) + "\n", "utf-8")
    return load_problem(str(home / "problems" / "probes.yaml"))


def run(
    problem: Problem, ready: ReadyPlan, seed: int, stay: int
) -> tuple[Line, list[JournalRecord]]:
    """One run on the virtual clock."""
    began = time.process_time()
    kept = Kept()
    driver = Simulator(HiddenCell(problem, None, seed=seed), SimulatorSettings(seed, spread=SPREAD))
    execution = RunExecution("x", problem, driver, Recorder(kept, driver.now_ms), TimedOrders())
    ending = execution.start(ready, SymbolicWorld.of(problem, initial_situation(problem).state))
    records = kept.records
    told = [each for each in records if each.kind is RecordKind.EXCEPTION]
    said = {
        each.content["action"] for each in told if each.content["exception"] == "stays_too_long"
    }
    broken = [pick for pick, lasted in stays(records) if stay and lasted > stay * 1000]
    orders = sum(each.kind is RecordKind.PLAN for each in records) - 1
    took = time.process_time() - began
    untold = len([pick for pick in broken if pick not in said])
    return Line(
        ending.outcome, ending.makespan_ms / 1000, len(broken), untold, orders, took
    ), records


def stays(records: list[JournalRecord]) -> list[tuple[str, int]]:
    """Each step that takes a probe out of the furnace, and how long the probe had been there
    when it began.
    """
    brought: dict[str, int] = {}
    found = []
    for each in (record for record in records if record.kind is RecordKind.DONE):
        name, _, rest = each.content["action"].partition("(")
        probe = rest.partition(",")[0]
        if name == "put" and "furnace" in rest:
            brought[probe] = each.at_ms
        elif name == "pick" and "furnace" in rest:
            found.append((each.content["action"], each.content["started_ms"] - brought[probe]))
    return found


def with_perfect_knowledge(
    problem: Problem, ready: ReadyPlan, records: list[JournalRecord], work: float
) -> float:
    """The makespan in seconds that CP-SAT finds for the plan with the durations that its steps had.

    0 if there is no such schedule: where steps took too long, nobody could have kept all stays.
    """
    lasted: dict[str, list[int]] = {}
    for each in (record for record in records if record.kind is RecordKind.DONE):
        lasted.setdefault(each.content["action"], []).append(
            each.at_ms - each.content["started_ms"]
        )
    known = {
        read_ground_atom(action): round(statistics.mean(each) / 1000)
        for action, each in lasted.items()
    }
    told = replace(problem, durations=known)
    steps = tuple(replace(s, duration=known.get(s.operator, s.duration)) for s in ready.plan.steps)
    made = time_plan(told, ground(told), replace(ready.plan, steps=steps), ScheduleLimits(work))
    if isinstance(made, Infeasible):
        return 0.0
    assert isinstance(made, Timetable), made
    return float(made.schedule.makespan)


@dataclass(frozen=True, slots=True)
class Told:
    """A start that was forecast `place` steps ahead, `near` if within the horizon: whether it came
    in its interval, and no further off than told; how far off that may be, in milliseconds.
    """

    place: int
    near: bool
    inside: bool
    close: bool
    off_ms: int


def forecasts(records: list[JournalRecord], tolerance: int, every: int = 7) -> list[Told]:
    """Each forecast of a start that a display could show behind every so many steps.

    The display shows whole seconds, so half a second is allowed. A step that was exchanged for
    another one, or that another plan has left out, counts as not begun in its interval.
    """
    standing, found, ended = Run("x", tolerance_ms=ANY_MS), list[Told](), 0
    begun: dict[str, list[tuple[int, int]]] = {}
    for each in records:
        if each.kind is RecordKind.DONE:
            begun.setdefault(each.content["action"], []).append(
                (each.number, each.content["started_ms"])
            )
    for each in records:
        standing.take(each)
        ended += each.kind is RecordKind.DONE
        if each.kind is RecordKind.DONE and ended % every == 0:
            left = {
                action: [ms for number, ms in came if number > each.number]
                for action, came in begun.items()
            }
            found += compared(standing, left, tolerance)
    return found


def compared(standing: Run, begun: dict[str, list[int]], tolerance: int) -> list[Told]:
    """The forecasts of starts as a run stands, beside those of the steps that have `begun` and
    ended after that.
    """
    windows = {step: window for step, window in standing.ahead().items() if window is not None}
    vague = [each.start_ms for each in windows.values() if each.off_ms > 1000 * tolerance]
    under_way, found = [action for _, action, *_ in standing.under_way.values()], []
    for place, (step, window) in enumerate(windows.items(), 1):
        action = standing.bars[step].step
        # the same step may come several times
        came = begun.get(action, [])[under_way.count(action) :]
        under_way.append(action)
        near = not vague or window.start_ms < min(vague)
        inside = bool(came) and window.low_ms - HALF_MS <= came[0] <= window.high_ms + HALF_MS
        close = bool(came) and abs(came[0] - window.start_ms) <= window.off_ms + HALF_MS
        found.append(Told(place, near, inside, close, window.off_ms))
    return found


def forecast_share(problem: Problem, ready: ReadyPlan, runs: int, tolerance: int) -> int:
    """Print the share of starts within their intervals, by how many steps ahead they were; 1 if
    it is not as stated.
    """
    lines: list[Told] = []
    for seed in range(runs):
        lines += forecasts(run(problem, ready, seed, 0)[1], tolerance)
    for least, most in ((1, 1), (2, 3), (4, 6), (7, 12), (13, 24), (25, 500), (1, 500)):
        shares(
            f"{least:>3} to {most:>3} steps ahead",
            [each for each in lines if least <= each.place <= most],
        )
    shares("    within the horizon", [each for each in lines if each.near])
    share = sum(each.inside for each in lines) / len(lines)
    return int(not LEAST <= share <= MOST)


def shares(what: str, told: list[Told]) -> None:
    """Print how many of some forecasts were right."""
    count = max(1, len(told))
    inside, close = (
        sum(getattr(each, key) for each in told) / count for key in ("inside", "close")
    )
    off = statistics.median(each.off_ms for each in told) / 1000 if told else 0.0
    sys.stdout.write(
        f"{what:<24} {len(told):>7} starts, {inside:6.1%} in the interval, {close:6.1%} as near "
        "as told, "
        f"which is {off:.0f} s sooner or later\n"
    )


def main() -> int:
    """Print what came of the runs; 1 if a bar is missed."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--probes", type=int, default=16)
    parser.add_argument("--runs", type=int, default=1_000)
    parser.add_argument("--known", type=int, default=50)
    parser.add_argument("--work", type=float, default=5.0)
    parser.add_argument("--stay", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--forecast", action="store_true")
    parser.add_argument("--tolerance", type=int, default=60)
    asked = parser.parse_args()
    kept = asked.json is not None and asked.json.is_file()
    found = [Line(*each) for each in json.loads(asked.json.read_text("utf-8"))] if kept else []
    with tempfile.TemporaryDirectory() as name:
        problem = problem_in(Path(name), asked.probes, asked.stay)
        ready = first_plan(problem)
        assert isinstance(ready, ReadyPlan), ready
        print(f"forecast {ready.makespan} s, {len(ready.plan.steps)} steps", flush=True)
        if asked.forecast:
            return forecast_share(problem, ready, asked.runs, asked.tolerance)
        one = partial(measured, problem, ready, asked)
        with ProcessPoolExecutor(asked.jobs) as pool:
            for line in pool.map(one, range(len(found), asked.runs)):
                found.append(line)
                if asked.json is not None:
                    rows = [[getattr(each, key) for key in Line.__annotations__] for each in found]
                    asked.json.write_text(json.dumps(rows) + "\n", "utf-8")
    return judged(found)


def measured(problem: Problem, ready: ReadyPlan, asked: argparse.Namespace, seed: int) -> Line:
    """One run, and what perfect knowledge makes of it for the first ones."""
    gc.set_threshold(100_000)  # as the commands do
    line, records = run(problem, ready, seed, asked.stay)
    if seed >= asked.known:
        return line
    return replace(line, known_s=with_perfect_knowledge(problem, ready, records, asked.work))


def judged(found: list[Line]) -> int:
    """Print the sums; 1 if a bar is missed."""
    known = [each for each in found if each.known_s]
    ratio = sum(e.makespan_s for e in known) / sum(e.known_s for e in known) if known else 0.0
    untold, lost = sum(e.untold for e in found), sum(e.outcome != "reached" for e in found)
    said = {
        "runs": len(found),
        "not reached": lost,
        "stays too long": sum(e.broken for e in found),
        "of them not told": untold,
        "orders changed": sum(e.reordered for e in found),
        "mean makespan (s)": round(statistics.mean(e.makespan_s for e in found), 1),
        "beside perfect knowledge": round(ratio, 4),
        "on so many": len(known),
        "processor seconds a run": round(statistics.mean(e.work_s for e in found), 2),
    }
    print(json.dumps(said))
    return int(untold > 0 or lost > 0 or ratio > SHARE)


if __name__ == "__main__":
    sys.exit(main())
