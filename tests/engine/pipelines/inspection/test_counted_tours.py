"""The bound of a tour counts what its plan counts: no order of few visits takes less, and none
is said to.
"""

import itertools
import random
from dataclasses import replace
from pathlib import Path

import pytest

from cellwright.engine.formats.report.plans.itinerary_report import itinerary_entry
from cellwright.engine.model.outcome import Found
from cellwright.engine.pipelines.planning.checked_plan import problem_of
from cellwright.engine.pipelines.planning.decomposition import by_sequence
from cellwright.engine.pipelines.planning.decomposition.counting import in_counted_order
from cellwright.engine.pipelines.planning.decomposition.part_chain import chain_of
from cellwright.engine.pipelines.planning.plan_objective import plan_for_objective
from cellwright.engine.stages.planning import SearchLimits
from cellwright.engine.stages.sequencing import TourLimits
from cellwright.kb.loader import load_problem
from cellwright.kb.model.planning_problem import Problem


def written(folder: Path, count: int, seed: int) -> Problem:
    chance = random.Random(seed)
    lines = [
        "problem: points",
        "domain: bulkhead",
        "objects:",
        f"  measurement: [m1..{count}]",
        "statics:",
    ]
    for number in range(1, count + 1):
        x, y = chance.randrange(-450_000, 450_000), chance.randrange(-950_000, 950_000)
        lines += [f"  - needs(m{number}, {chance.choice(('thickness', 'profile'))})"]
        lines += [f"  - position(m{number}, {x}, {y}, 0)", f"  - normal(m{number}, 0, 0, -1000)"]
        lines += [f"  - tolerance(m{number}, 200)"]
    goals = [f"  - measured(_, _, meas(m{number}))" for number in range(1, count + 1)]
    (folder / "p.yaml").write_text("\n".join([*lines, "goals:", *goals]) + "\n")
    return load_problem(str(folder / "p.yaml"))


@pytest.mark.parametrize("seed", range(2))
def test_no_order_takes_less_than_the_bound_and_the_proved_one_takes_it(
    tmp_path: Path, seed: int
) -> None:
    problem = written(tmp_path, 4, seed)
    found = by_sequence(problem)
    assert found is not None
    assert isinstance(found.outcome, Found)
    counted = found.itinerary.counted
    if counted is None:
        assert len(found.itinerary.runs) == 1
        return
    line = chain_of(problem, TourLimits())
    parts = found.itinerary.parts(problem)
    every = [line.trial(order)[0] for order in itertools.permutations(parts)]
    assert counted.proved
    assert counted.takes == counted.least == min(every)
    assert counted.takes == sum(step.duration for step in found.outcome.plan.steps)


def test_twelve_points_are_proved_through_plan() -> None:
    run = plan_for_objective(problem_of("bulkhead/twelve_points"), SearchLimits())
    content = itinerary_entry(run)["sequence"]
    assert content["proved"]
    assert content["cost"] == content["lower_bound"] == 205
    assert content["unit"] == "s"
    assert content["ways"]["unit"] == "µm"
    assert 0 < content["ways"]["lower_bound"] <= content["ways"]["cost"]


def test_an_interrupt_ends_the_count_between_two_visits(tmp_path: Path) -> None:
    problem = written(tmp_path, 4, 0)
    sequenced = by_sequence(problem)
    assert sequenced is not None
    way = replace(sequenced.itinerary, counted=None, fixed=False)
    calls = itertools.count()
    limits = TourLimits(interrupted=lambda: next(calls) > 1)
    counted = in_counted_order(way, chain_of(problem, TourLimits()), limits)
    assert counted.counted is None
    assert next(calls) == 3
