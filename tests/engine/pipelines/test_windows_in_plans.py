"""Plans, schedules and runs wait for the windows of measurements; what cannot be met is told with its reason."""

import random
from collections.abc import Mapping
from io import StringIO
from itertools import pairwise, permutations
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from engine.formats.report.itinerary import entry
from engine.formats.report.itinerary import text as shown
from engine.model.execution import RecordKind
from engine.model.outcome import Found
from engine.model.schedule import Timetable
from engine.model.tour import Tour, TourProblem, Visit, violations
from engine.pipelines.objective import Run, fastest, plan
from engine.pipelines.plan_files import missed_windows
from engine.pipelines.timetable import timetable
from engine.stages.planning import Limits
from engine.stages.sequencing import sequence
from engine.stages.sequencing.windows import clash
from kb.model.plan import Claims
from tests.engine.pipelines.execution.cells import executed
from tests.engine.pipelines.test_sequenced_parts import inspection, text

Windows = Mapping[str, tuple[int, int]]


def facts(windows: Windows) -> str:
    return "\n".join(f"  - window({name}, {first}, {last})" for name, (first, last) in windows.items())


def begins(run: Run) -> dict[str, int]:
    """When measurements begin in a plan, by its steps: plain reading that shares nothing with the planner's bookkeeping."""
    assert isinstance(run.outcome, Found)
    assert run.starts is not None
    steps = [step for step in run.outcome.plan.steps if step.operator.name.endswith("_measure")]
    return {str(step.operator.arguments[2]): run.starts[step.id] for step in steps}


def outside(found: Mapping[str, int], windows: Windows) -> set[str]:
    first = min(found, key=lambda name: found[name])
    begin = found[first] - windows.get(first, (0, 0))[0]
    return {name for name, (early, late) in windows.items() if not early <= found[name] - begin <= late}


def said(run: Run) -> str:
    console = Console(width=600, record=True, file=StringIO())
    console.print(shown(run, "s"))
    return console.export_text()


def test_an_arm_that_comes_too_early_waits(tmp_path: Path) -> None:
    windows = {"m2": (200, 300), "m4": (500, 600)}
    problem = inspection(tmp_path, text(5, more=facts(windows)))
    run = plan(problem)
    assert not outside(begins(run), windows)
    assert "missed_windows" not in entry(run)
    assert "Outside" not in said(run)


@pytest.mark.parametrize("seed", range(4))
def test_windows_that_some_plan_meets_are_met(tmp_path: Path, seed: int) -> None:
    """Windows are laid around the begins of a plan in another order, so that they can be met."""
    chance = random.Random(seed)
    names = [f"m{n}" for n in range(1, 8)]
    chance.shuffle(names)
    order = "\n".join(f"  - before({one}, {other})" for one, other in pairwise(names))
    asked = inspection(tmp_path, text(7, seed, more=order))
    found = begins(plan(asked))
    begin = min(found.values())
    windows = {
        name: (max(0, found[name] - begin - chance.randrange(10)), found[name] - begin + chance.randrange(10))
        for name in chance.sample(names, 4)
    }
    problem = inspection(tmp_path, text(7, seed, more=facts(windows)))
    run = plan(problem)
    assert not outside(begins(run), windows), said(run)


def test_windows_that_cannot_be_met_are_told_with_the_reason(tmp_path: Path) -> None:
    windows = {"m1": (0, 0), "m2": (0, 0)}
    problem = inspection(tmp_path, text(4, more=facts(windows)))
    run = plan(problem)
    missed = outside(begins(run), windows)
    assert missed
    assert set(entry(run)["missed_windows"]) == missed
    assert "m1 and m2 cannot both begin in their windows" in said(run)
    assert "Outside their windows" in said(run)


def test_a_schedule_keeps_windows(tmp_path: Path) -> None:
    windows = {"m1": (150, 400), "m3": (0, 300)}
    problem = inspection(tmp_path, text(5, more=facts(windows)))
    run = plan(problem)
    assert isinstance(run.outcome, Found)
    for made in (timetable(problem, run.outcome.plan), fastest(problem, Limits())):
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
        str(each.content["action"]): each.at_ms // 1000 for each in records if each.kind is RecordKind.COMMAND
    }
    found = {a.split(", ")[-1].rstrip(")"): at for a, at in sent.items() if "_measure(" in a}
    assert ending.outcome == "reached"
    assert not outside(found, windows)


def test_the_checker_of_plan_files_tells_windows_that_claimed_starts_miss(tmp_path: Path) -> None:
    problem = inspection(tmp_path, text(3, more=facts({"m2": (200, 300)})))
    run = plan(problem)
    assert isinstance(run.outcome, Found)
    assert missed_windows(problem, run.outcome.plan, Claims(dict(run.starts or {}))) == {}
    assert set(missed_windows(problem, run.outcome.plan)) == {"m2"}


@pytest.mark.parametrize("seed", range(60))
def test_two_visits_that_clash_are_in_no_tour(seed: int) -> None:
    """Against all orders of few visits."""
    chance = random.Random(seed)
    n = chance.randrange(2, 6)
    ways = np.array([[0 if a == b else chance.randrange(1, 9) for b in range(n)] for a in range(n)], np.int64)
    starts = [chance.randrange(12) for _ in range(n)]
    visits = tuple(
        Visit(f"v{k}", duration=chance.randrange(4), window=(first, first + chance.randrange(4)))
        for k, first in enumerate(starts)
    )
    problem = TourProblem("small", visits, ways, closed=False)
    possible = any(not violations(problem, order) for order in permutations(range(n)))
    assert not (possible and clash(problem))
    assert isinstance(sequence(problem), Tour) == possible
