"""Times that nobody decides: verdicts of three algorithms, large networks, and plans in many runs.

`python benchmarks/robust_times.py` prints and keeps: seconds for networks of 1,000 points with 100
uncertain links and 2,500 with 250; how often the algorithms agree on random networks, and with
games that are played out; in how many of 1,000 runs through the executive's table a window is
broken, with a policy and without, beside the chance that was told before.
"""

import argparse
import heapq
import json
import random
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from cellwright.engine.model.outcome import Found
from cellwright.engine.model.start_rules import NO_RULES, StartRules
from cellwright.engine.model.uncertain_times import (
    ORIGIN,
    Controllable,
    DifferenceBound,
    NegativeCycle,
    UncertainLink,
    UncertainNetwork,
)
from cellwright.engine.pipelines import planning
from cellwright.engine.pipelines.execution.executable_plan import compile_ready_plan
from cellwright.engine.pipelines.planning.robustness.plan_network import (
    PlanNetwork,
    network_of_plan,
)
from cellwright.engine.pipelines.planning.robustness.robust_plan import judge_robustness
from cellwright.engine.pipelines.simulators.simulator_settings import (
    DRAWN,
    SimulatorSettings,
    duration_in_range,
)
from cellwright.engine.stages import execution
from cellwright.engine.stages.planning import SearchLimits
from cellwright.engine.stages.uncertainty.controllability import check_controllability
from cellwright.engine.stages.uncertainty.cycle_replay import replay_cycle
from cellwright.engine.stages.uncertainty.edge_generation import has_policy
from cellwright.kb import loader
from cellwright.kb.model.planning_problem import Problem
from tests.engine.stages.uncertainty.time_games import has_winning_policy, random_network

TOLERANCE_MS = 2  # times are rounded to milliseconds


def large_network(points: int, links: int, seed: int, tight: float) -> UncertainNetwork:
    """Activities in lanes that wait for each other, some of uncertain length, with windows between
    them; the less `tight`, the wider these.
    """
    chance, lanes = random.Random(seed), 5
    activities = (points - 1) // 2
    varying = set(chance.sample(range(activities), links))
    names, bounds, uncertain = ["0"], list[DifferenceBound](), list[UncertainLink]()
    last, when = [0] * lanes, {0: 0}
    for number in range(activities):
        start, end = len(names), len(names) + 1
        names += [f"start {number}", f"end {number}"]
        lane = chance.randrange(lanes)
        before = [last[lane], *([chance.choice(last)] if chance.random() < 0.3 else [])]
        bounds += [DifferenceBound(start, other, 0) for other in (0, *before)]
        least = chance.randint(1, 50)
        most = least + chance.randint(1, 30)
        if number in varying:
            uncertain.append(UncertainLink(start, end, least, most))
        else:
            bounds += [DifferenceBound(start, end, most), DifferenceBound(end, start, -least)]
        when[start] = max(when[other] for other in before)
        when[end] = when[start] + (most if number in varying else least)
        last[lane] = end
        if chance.random() < 0.3:
            other = chance.randrange(max(0, start - 40), start)
            bounds.append(DifferenceBound(other, end, int((when[end] - when[other]) * tight) + 4))
    return UncertainNetwork(tuple(names), tuple(bounds), tuple(uncertain))


def networks_about(points: int, links: int, seed: int) -> tuple[UncertainNetwork, ...]:
    """The network with the narrowest windows that has a policy, and one a little narrower."""
    narrow, wide = 0.0, 2.0
    while wide - narrow > 1e-4:
        middle = (narrow + wide) / 2
        verdict = check_controllability(large_network(points, links, seed, middle))
        narrow, wide = (narrow, middle) if verdict == Controllable() else (middle, wide)
    return tuple(large_network(points, links, seed, tight) for tight in (wide, narrow))


def measure_large() -> Iterator[dict[str, Any]]:
    """Seconds for large networks with a policy and without one."""
    for points, links in ((1000, 100), (2500, 250)):
        for seed in range(4):
            for network in networks_about(points, links, seed):
                began = time.process_time()
                verdict = check_controllability(network)
                seconds = time.process_time() - began
                faults = replay_cycle(network, verdict) if verdict != Controllable() else ""
                yield {
                    "points": points,
                    "links": links,
                    "seconds": round(seconds, 3),
                    "controllable": verdict == Controllable(),
                    "replay": faults,
                    "derived": len(verdict.derived) if isinstance(verdict, NegativeCycle) else 0,
                }


def compare_verdicts(count: int, games: int) -> dict[str, int]:
    """How often the algorithms disagree, and how many cycles do not replay."""
    counts = {"networks": count, "controllable": 0, "disagreements": 0, "no replay": 0}
    for seed in range(count):
        network = random_network(5_000_000 + seed)
        verdict = check_controllability(network)
        counts["controllable"] += verdict == Controllable()
        counts["disagreements"] += (verdict == Controllable()) is not has_policy(network)
        if isinstance(verdict, NegativeCycle):
            counts["no replay"] += replay_cycle(network, verdict) != ""
    counts |= {"games": games, "games with a policy": 0, "games that disagree": 0}
    for seed in range(games):
        network = random_network(
            6_000_000 + seed, links=seed % 7, spare=2, least=seed % 2, longest=4
        )
        verdict = check_controllability(network)
        counts["games with a policy"] += verdict == Controllable()
        won = has_winning_policy(network)
        counts["games that disagree"] += (verdict == Controllable()) is not won
    return counts


DOMAIN = """
domain: ovens
types: {{item: object, oven: object, place: object}}
objects:
  oven: [{ovens}]
  place: [shelf, rack]
statics:
  longest_stay(oven, time): {{}}
  due(item, time): {{}}
  heats(item, time): {{}}
fluents:
  stands(item, place): {{}}
  inside(item, oven): {{}}
  warm(item): {{}}
  labelled(item): {{}}
  free(oven): {{}}
operators:
  load(I, O):
    preconditions: stands(I, shelf), free(O)
    adds: inside(I, O)
    deletes: stands(I, shelf), free(O)
    resources: arm
    duration: {load}
  heat(I, O):
    preconditions: inside(I, O)
    adds: warm(I)
    where: heats(I, N)
    resources: O
    duration: {heat}
  label(I):
    preconditions: stands(I, shelf)
    adds: labelled(I)
    resources: arm
    duration: {label}
  unload(I, O):
    preconditions: inside(I, O), warm(I)
    adds: stands(I, rack), free(O)
    deletes: inside(I, O)
    resources: arm
    duration: {unload}
"""


def write_cell(folder: Path, seed: int) -> Path:
    """A cell with ovens whose steps have ranges, and a problem with limits on stays."""
    chance = random.Random(seed)
    ovens = [f"o{n}" for n in range(chance.randint(1, 2))]

    def lasting(least: int, width: int) -> str:
        most = least + chance.randint(1, width)
        usual = chance.randint(least, most)
        spread = f", spread: {chance.randint(1, width)}" if chance.random() < 0.4 else ""
        return f"{{from: {least} s, to: {most} s, usual: {usual} s{spread}}}"

    width = chance.randint(5, 30)
    durations = {
        "load": lasting(10, 8),
        "heat": f"{{from: 60 s, to: {60 + width} s, usual: {60 + chance.randint(0, width)} s}}",
        "label": lasting(15, 15),
        "unload": chance.choice(["10 s", lasting(8, 6)]),
    }
    text = DOMAIN.format(ovens=", ".join(ovens), **durations).replace(
        "    where: heats(I, N)\n", ""
    )
    (folder / "domain.yaml").write_text(text.replace("  heats(item, time): {}\n", ""))
    items = [f"i{n}" for n in range(chance.randint(2, 4))]
    stay = 60 + width + chance.randint(-width, 30)
    lines = [
        "problem: batch",
        "domain: domain.yaml",
        f"objects: {{item: [{', '.join(items)}]}}",
        "statics:",
        *(f"  - longest_stay({oven}, {stay})" for oven in ovens),
        "initial:",
        *(f"  - stands({item}, shelf)" for item in items),
        *(f"  - free({oven})" for oven in ovens),
        "goals:",
        *(f"  - {goal}({item}{more})" for item in items for goal, more in GOALS),
    ]
    problem = folder / "problem.yaml"
    problem.write_text("\n".join(lines) + "\n")
    return problem


JOINING = """
domain: joining
types: {item: object, oven: object}
objects:
  item: [tall, small]
  oven: [wide, narrow]
statics:
  longest_stay(oven, time): {}
  fits(item, oven): {}
fluents:
  waits(item): {}
  inside(item, oven): {}
  warm(item): {}
  joined(item, item): {}
operators:
  load(I, O):
    preconditions: waits(I)
    where: fits(I, O)
    adds: inside(I, O)
    deletes: waits(I)
    resources: arm
    duration: LOAD
  heat_long(I):
    preconditions: inside(I, wide)
    adds: warm(I)
    resources: wide
    duration: LONG
  heat_short(I):
    preconditions: inside(I, narrow)
    adds: warm(I)
    resources: narrow
    duration: SHORT
  join(I, J):
    preconditions: inside(I, wide), inside(J, narrow), warm(I), warm(J)
    adds: joined(I, J)
    deletes: inside(I, wide), inside(J, narrow)
    resources: arm
    duration: 10 s
"""


def write_joining(folder: Path, seed: int) -> Path:
    """A cell in which what is heated briefly has to be loaded so that both are warm in time: the
    policy waits for the end of the long heating, or for a time.
    """
    chance = random.Random(seed)
    width, brief = chance.randint(5, 70), chance.randint(1, 6)
    text = JOINING.replace("LOAD", f"{{from: 8 s, to: {8 + brief} s}}")
    text = text.replace("LONG", f"{{from: 60 s, to: {60 + width} s}}")
    text = text.replace("SHORT", f"{{from: 20 s, to: {20 + brief} s, spread: 2 s}}")
    (folder / "domain.yaml").write_text(text)
    brief_stay = 22 + brief + chance.randint(0, width // 3)
    long_stay = 60 + width + 30 + brief + chance.randint(-10, 10)
    problem = folder / "problem.yaml"
    problem.write_text(
        "problem: pair\ndomain: domain.yaml\nstatics:\n"
        f"  - longest_stay(wide, {long_stay})\n  - longest_stay(narrow, {brief_stay})\n"
        "  - fits(tall, wide)\n  - fits(small, narrow)\n"
        "initial: ['waits(tall)', 'waits(small)']\ngoals: ['joined(tall, small)']\n"
    )
    return problem


GOALS = (("stands", ", rack"), ("warm", ""), ("labelled", ""))


@dataclass
class TableRun:
    """One run of a program through the executive's table, with durations drawn from the ranges."""

    made: PlanNetwork
    program: execution.ActivityProgram
    seed: int

    def times(self) -> dict[int, tuple[int, int]]:
        """When each step has started and ended, in milliseconds."""
        standing = execution.standing_of(self.program, 0, 1)
        ends: list[tuple[int, int]] = []
        times: dict[int, tuple[int, int]] = {}
        event: execution.Event = execution.Began()
        now = 0
        while True:
            standing, effects = execution.advance_run(self.program, standing, event, now)
            for effect in effects:
                if isinstance(effect, execution.Dispatch) and effect.activity is not None:
                    lasts = self._duration_ms(effect.activity)
                    times[effect.activity] = (now, now + lasts)
                    heapq.heappush(ends, (now + lasts, effect.number))
            if not ends and standing.finished(self.program):
                return times
            due = execution.next_time(self.program, standing)
            if ends and (due is None or ends[0][0] <= due):
                now, number = heapq.heappop(ends)
                event = execution.Replied(number)
            else:
                assert due is not None, "nothing can begin any more"
                now, event = due, execution.TimePassed()

    def _duration_ms(self, activity: int) -> int:
        step = next(s for s in self.made.plan.steps if int(s.id) == activity)
        lasts = self.made.ranges[step.id]
        if not lasts.varies:
            return 1000 * lasts.usual
        settings = SimulatorSettings(seed=self.seed, durations=DRAWN)
        return round(1000 * duration_in_range(settings, str(step.operator), 1, lasts))

    def broken(self) -> int:
        """How many windows are broken."""
        times = self.times()
        return sum(
            not self._keeps(self._at(times, window.later) - self._at(times, window.earlier), window)
            for window in self.made.windows
        )

    def _keeps(self, lasts: int, window: Any) -> bool:
        least = -(10**9) if window.least is None else 1000 * window.least - TOLERANCE_MS
        most = 10**9 if window.most is None else 1000 * window.most + TOLERANCE_MS
        return bool(least <= lasts <= most)

    def _at(self, times: Mapping[int, tuple[int, int]], point: int) -> int:
        if point == ORIGIN:
            return 0
        step = self.made.plan.steps[(point - 1) // 2]
        return times[int(step.id)][1 - point % 2]


def run_cell(seed: int, runs: int) -> dict[str, Any] | None:
    """What was told of a cell, and what came of it in many runs; None if it has no plan."""
    with tempfile.TemporaryDirectory() as folder:
        write = write_joining if seed % 2 else write_cell
        problem = loader.load_problem(write(Path(folder), seed))
        plain = planning.plan_for_objective(problem, SearchLimits())
        if not isinstance(plain.outcome, Found) or plain.timetable is None:
            return None
        run, robust = planning.make_robust(problem, plain)
        table = plain.timetable
        as_it_is = judge_robustness(problem, table.plan, table.starts, timed=True)
        assert robust is not None
        assert run.timetable is not None
        entry: dict[str, Any] = {
            "cell": seed,
            "steps": len(plain.outcome.plan.steps),
            "robust": robust.is_robust,
            "waits": sum(len(rule.waits) for rule in robust.rules.values()),
        }
        if robust.is_robust:
            entry["broken with the policy"] = _broken(problem, run, robust.rules, runs, seed)
        entry["told"] = round(as_it_is.kept, 4)
        entry["kept"] = round(1 - _broken(problem, plain, NO_RULES, runs, seed) / runs, 4)
        return entry


def _broken(problem: Problem, run: planning.Run, rules: StartRules, runs: int, cell: int) -> int:
    """In how many runs a window is broken."""
    assert run.timetable is not None
    table = run.timetable
    ready = compile_ready_plan(problem, table.plan, table.starts, 0, rules=rules)
    made = network_of_plan(problem, table.plan, table.starts)
    program = ready.compiled.program
    first = 1_000_000 * cell
    return sum(TableRun(made, program, first + seed).broken() > 0 for seed in range(runs))


def main() -> None:
    """Measure, print and keep."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--networks", type=int, default=2000)
    parser.add_argument("--games", type=int, default=700)
    parser.add_argument("--cells", type=int, default=12)
    parser.add_argument("--runs", type=int, default=1000)
    parser.add_argument("--json", type=Path)
    asked = parser.parse_args()
    answer: dict[str, Any] = {"large": [], "runs": []}
    for entry in measure_large():
        answer["large"].append(entry)
        print(entry)
    answer["verdicts"] = compare_verdicts(asked.networks, asked.games)
    print(answer["verdicts"])
    for seed in range(asked.cells):
        cell = run_cell(seed, asked.runs)
        if cell is not None:
            answer["runs"].append(cell)
            print(cell)
    if asked.json:
        asked.json.write_text(json.dumps(answer, indent=1))


if __name__ == "__main__":
    main()
