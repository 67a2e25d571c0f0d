"""Plans, schedules and runs wait for the windows of measurements; what cannot be met is told
with its reason.
"""

import random
from collections.abc import Mapping
from io import StringIO
from itertools import pairwise, permutations
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from cellwright.engine.formats.report.plans.plan_answer import PlanAnswer, plan_answer_content
from cellwright.engine.formats.report.plans.plan_answer import plan_answer_text as shown
from cellwright.engine.model.outcome import Found
from cellwright.engine.model.planning_choices import SequenceChoice
from cellwright.engine.model.run_protocol import JournalRecord, RecordKind
from cellwright.engine.model.shop_scheduling import Timetable
from cellwright.engine.model.tour_problem import Tour, TourProblem, Visit, tour_violations
from cellwright.engine.pipelines.inspection.tour_demands import as_facts, of_options
from cellwright.engine.pipelines.planning.plan_files import unmet_times
from cellwright.engine.pipelines.planning.plan_objective import (
    Run,
    plan_fastest,
    plan_for_objective,
)
from cellwright.engine.pipelines.planning.timetable import make_timetable
from cellwright.engine.pipelines.simulators.simulator_settings import Injection
from cellwright.engine.stages.planning import SearchLimits
from cellwright.engine.stages.sequencing import sequence_tour
from cellwright.engine.stages.sequencing.tour_solver import clashing_windows
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.model.plan_model import Claims
from cellwright.kb.model.planning_problem import Problem
from tests.engine.pipelines.execution.executed_cells import executed
from tests.engine.pipelines.planning.test_decomposition import inspection, text

Windows = Mapping[str, tuple[int, int]]


def facts(windows: Windows) -> str:
    return "\n".join(
        f"  - window({name}, {first}, {last})" for name, (first, last) in windows.items()
    )


def begins(run: Run) -> dict[str, int]:
    """When measurements begin in a plan, by its steps: plain reading that shares nothing with
    the planner's bookkeeping.
    """
    assert isinstance(run.outcome, Found)
    assert run.starts is not None
    steps = [step for step in run.outcome.plan.steps if step.operator.name.endswith("_measure")]
    return {str(step.operator.arguments[2]): run.starts[step.id] for step in steps}


def outside(found: Mapping[str, int], windows: Windows) -> set[str]:
    first = min(found, key=lambda name: found[name])
    begin = found[first] - windows.get(first, (0, 0))[0]
    return {
        name for name, (early, late) in windows.items() if not early <= found[name] - begin <= late
    }


def said(problem: Problem, run: Run) -> str:
    console = Console(width=600, record=True, file=StringIO())
    console.print(shown(PlanAnswer(run, problem), False, False))
    return console.export_text()


def test_an_arm_that_comes_too_early_waits(tmp_path: Path) -> None:
    windows = {"m2": (200, 300), "m4": (500, 600)}
    problem = inspection(tmp_path, text(5, more=facts(windows)))
    run = plan_for_objective(problem)
    assert not outside(begins(run), windows)
    assert "missed_windows" not in plan_answer_content(PlanAnswer(run, problem), False)
    assert "Outside" not in said(problem, run)


@pytest.mark.parametrize("seed", range(4))
def test_windows_that_some_plan_meets_are_met(tmp_path: Path, seed: int) -> None:
    """Windows are laid around the begins of a plan in another order, so that they can be met."""
    chance = random.Random(seed)
    names = [f"m{n}" for n in range(1, 8)]
    chance.shuffle(names)
    order = "\n".join(f"  - before({one}, {other})" for one, other in pairwise(names))
    asked = inspection(tmp_path, text(7, seed, more=order))
    found = begins(plan_for_objective(asked))
    begin = min(found.values())
    windows = {
        name: (
            max(0, found[name] - begin - chance.randrange(10)),
            found[name] - begin + chance.randrange(10),
        )
        for name in chance.sample(names, 4)
    }
    problem = inspection(tmp_path, text(7, seed, more=facts(windows)))
    run = plan_for_objective(problem)
    assert not outside(begins(run), windows), said(problem, run)


def test_windows_that_cannot_be_met_are_told_with_the_reason(tmp_path: Path) -> None:
    windows = {"m1": (0, 0), "m2": (0, 0)}
    problem = inspection(tmp_path, text(4, more=facts(windows)))
    run = plan_for_objective(problem)
    missed = outside(begins(run), windows)
    assert missed
    assert set(plan_answer_content(PlanAnswer(run, problem), False)["missed_windows"]) == missed
    assert "m1 and m2 cannot both begin in their windows" in said(problem, run)
    assert "Outside their windows" in said(problem, run)


def test_a_schedule_keeps_windows(tmp_path: Path) -> None:
    windows = {"m1": (150, 400), "m3": (0, 300)}
    problem = inspection(tmp_path, text(5, more=facts(windows)))
    run = plan_for_objective(problem)
    assert isinstance(run.outcome, Found)
    for made in (make_timetable(problem, run.outcome.plan), plan_fastest(problem, SearchLimits())):
        assert isinstance(made, Timetable)
        own = Run(Found(made.plan), made)
        assert not outside(begins(own), windows)
        assert made.missed == {}
        assert made.schedule.proved


def test_a_run_begins_no_measurement_before_its_window(tmp_path: Path) -> None:
    windows = {"m2": (200, 300), "m4": (500, 600)}
    inspection(tmp_path, text(4, more=facts(windows)))
    ending, records, _ = executed(str(tmp_path / "points.yaml"))
    sent = {
        str(each.content["action"]): each.at_ms // 1000
        for each in records
        if each.kind is RecordKind.COMMAND
    }
    found = {a.split(", ")[-1].rstrip(")"): at for a, at in sent.items() if "_measure(" in a}
    assert ending.outcome == "reached"
    assert not outside(found, windows)


def test_the_checker_of_plan_files_tells_windows_that_claimed_starts_miss(tmp_path: Path) -> None:
    problem = inspection(tmp_path, text(3, more=facts({"m2": (200, 300)})))
    run = plan_for_objective(problem)
    assert isinstance(run.outcome, Found)
    assert unmet_times(problem, run.outcome.plan, Claims(dict(run.starts or {}))).missed == {}
    assert set(unmet_times(problem, run.outcome.plan).missed) == {"m2"}


def test_an_order_that_a_plan_breaks_is_told_with_its_pair(tmp_path: Path) -> None:
    found = begins(plan_for_objective(inspection(tmp_path, text(4))))
    first, *_, last = sorted(found, key=lambda name: found[name])
    asked = inspection(tmp_path, text(4, more=f"  - before({last}, {first})"))
    kept, free = plan_for_objective(asked), plan_for_objective(asked, order=SequenceChoice.FREE)
    assert begins(kept)[last] < begins(kept)[first]
    for run in (kept, free):
        own = begins(run)
        broken = [] if own[last] < own[first] else [[last, first]]
        assert plan_answer_content(PlanAnswer(run, asked), False).get("broken_orders", []) == broken
    against = inspection(tmp_path, text(4))
    told = plan_for_objective(against)
    assert isinstance(told.outcome, Found)
    turned = unmet_times(asked, told.outcome.plan, Claims(dict(told.starts or {}))).turned
    assert turned == ((last, first),)


def test_options_ask_what_facts_ask(tmp_path: Path) -> None:
    windows = {"m2": (200, 300), "m4": (500, 600)}
    plain = inspection(tmp_path, text(5, more="  - window(m2, 7, 9)\n  - lasts(m1, 3)"))
    asked = as_facts(plain, of_options(["m2=200..300, m4=500..600"], ["m1=4"], ["m5,m1"]))
    wanted = text(5, more=facts(windows) + "\n  - lasts(m1, 4)\n  - before(m5, m1)")
    assert {*asked.statics} == {*inspection(tmp_path, wanted).statics}
    own = begins(plan_for_objective(asked))
    assert not outside(own, windows)
    assert own["m5"] < own["m1"]


@pytest.mark.parametrize(
    ("asked", "code"),
    [
        ((["m77=1..2"], [], []), "K101"),
        (([], [], ["m1,m2", "m2,m1"]), "K115"),
        ((["m1=9..2"], [], []), "K406"),
    ],
)
def test_options_that_ask_nonsense_are_refused(
    tmp_path: Path, asked: tuple[list[str], list[str], list[str]], code: str
) -> None:
    problem = inspection(tmp_path, text(3))
    with pytest.raises(InvalidInput) as caught:
        as_facts(problem, of_options(*asked))
    assert [each.code for each in caught.value.diagnostics] == [code]


@pytest.mark.parametrize("seed", range(60))
def test_two_visits_that_clash_are_in_no_tour(seed: int) -> None:
    """Against all orders of few visits."""
    chance = random.Random(seed)
    n = chance.randrange(2, 6)
    ways = np.array(
        [[0 if a == b else chance.randrange(1, 9) for b in range(n)] for a in range(n)], np.int64
    )
    starts = [chance.randrange(12) for _ in range(n)]
    visits = tuple(
        Visit(f"v{k}", duration=chance.randrange(4), window=(first, first + chance.randrange(4)))
        for k, first in enumerate(starts)
    )
    problem = TourProblem("small", visits, ways, closed=False)
    possible = any(not tour_violations(problem, order) for order in permutations(range(n)))
    assert not (possible and clashing_windows(problem))
    assert isinstance(sequence_tour(problem), Tour) == possible


def _sent(records: list[JournalRecord]) -> dict[str, list[int]]:
    """When the commands for measurements were sent, in seconds of the run's clock."""
    found: dict[str, list[int]] = {}
    for each in records:
        action = str(each.content.get("action", ""))
        if each.kind is RecordKind.COMMAND and "_measure(" in action:
            found.setdefault(action.split(", ")[-1].rstrip(")"), []).append(each.at_ms // 1000)
    return found


@pytest.mark.parametrize(
    ("kind", "step", "cause"),
    [("thickness", "us_measure", "missing_couplant"), ("profile", "laser_measure", "laser_dirty")],
)
def test_a_recovery_keeps_the_windows_of_the_tour_that_is_under_way(
    tmp_path: Path, kind: str, step: str, cause: str
) -> None:
    windows = {"m2": (600, 800), "m4": (1000, 1100)}
    inspection(tmp_path, text(4, more=facts(windows), kinds=kind))
    ending, records, _ = executed(str(tmp_path / "points.yaml"), [Injection(step, cause, 2)])
    assert ending.outcome == "reached"
    assert any(each.kind is RecordKind.EXCEPTION for each in records)
    found = _sent(records)
    assert not outside({name: times[-1] for name, times in found.items()}, windows), found
    assert max(len(times) for times in found.values()) == 2, "a measurement was made again"


def test_a_recovery_tells_the_windows_that_it_cannot_keep(tmp_path: Path) -> None:
    found = begins(plan_for_objective(inspection(tmp_path, text(5, kinds="thickness"))))
    begin, last = min(found.values()), max(found, key=lambda name: found[name])
    inspection(tmp_path, text(5, more=facts({last: (0, found[last] - begin)}), kinds="thickness"))
    _, records, _ = executed(
        str(tmp_path / "points.yaml"), [Injection("us_measure", "missing_couplant", 2)]
    )
    told = [each.content["why"] for each in records if each.kind is RecordKind.DECISION]
    assert any("Outside their windows" in each and last in each for each in told), told
