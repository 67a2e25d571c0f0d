"""Plans whose steps last as long as they like: policies, cycles, what would have to change."""

from dataclasses import replace
from pathlib import Path

import pytest

from cellwright.engine.formats.report.plans.robustness_report import (
    robustness_entry,
    robustness_lines,
)
from cellwright.engine.model.robustness import RobustPlan
from cellwright.engine.pipelines import planning
from cellwright.engine.pipelines.planning.robustness.robust_run import LONGEST_ORDER
from cellwright.kb import loader
from tests.engine.pipelines.planning.robustness.uncertain_cells import write_joining, write_oven


def _robust(problem_file: Path) -> tuple[planning.Run, RobustPlan]:
    problem = loader.load_problem(problem_file)
    run, robust = planning.make_robust(problem, planning.plan_for_objective(problem))
    assert robust is not None
    return run, robust


def test_a_plan_with_room_has_a_policy(tmp_path: Path) -> None:
    run, robust = _robust(write_oven(tmp_path, stay=75, heat="{from: 60 s, to: 75 s}"))
    assert robust.is_robust
    assert robust.worst_end == 14 + 75 + 10
    assert run.timetable is not None
    assert not run.timetable.overstays
    assert 0.9 < robust.kept < 1.0  # if loading ends soon, heating waits for its forecast


def test_a_stay_that_may_be_too_long_is_told_as_a_cycle_with_the_least_relaxation(
    tmp_path: Path,
) -> None:
    _, robust = _robust(write_oven(tmp_path, stay=70, heat="{from: 60 s, to: 75 s}"))
    assert not robust.is_robust
    assert robust.lacks == 5
    assert "2 heat(bread) may last 75 s" in robust.cycle
    assert robust.widened is not None
    assert [(w.says, w.by) for w in robust.widened] == [("bread stays in oven for at most 70 s", 5)]
    assert robust.narrowed is not None
    assert [(r.operator, r.after) for r in robust.narrowed] == [("heat(bread)", (60, 70))]
    assert robust.within == pytest.approx(10 / 15)
    assert 0.55 < robust.kept < 10 / 15


def test_slack_is_bought_where_it_costs_least_chance(tmp_path: Path) -> None:
    """Two seconds are missing. Heating hardly ever takes so long, loading often does."""
    heat = "{from: 60 s, to: 75 s, usual: 64 s, spread: 2 s}"
    cell = write_oven(tmp_path, stay=90, heat=heat, due=97)
    _, robust = _robust(cell)
    assert not robust.is_robust
    assert robust.narrowed is not None
    assert {r.operator for r in robust.narrowed} == {"heat(bread)"}
    assert robust.within > 0.99


def test_a_policy_waits_for_an_end_or_for_a_time(tmp_path: Path) -> None:
    cell = write_joining(
        tmp_path,
        load="{from: 8 s, to: 12 s}",
        long="{from: 60 s, to: 120 s}",
        short="{from: 20 s, to: 24 s}",
        stays=(200, 40),
    )
    run, robust = _robust(cell)
    assert robust.is_robust
    assert any(rule.waits for rule in robust.rules.values())
    assert 0.2 < robust.kept < 0.8
    entry = robustness_entry(robust)
    assert entry["robust"] is True
    assert any("waits" in rule for rule in entry["policy"])
    assert run.timetable is not None
    assert not run.timetable.overstays


def test_the_answer_in_words(tmp_path: Path) -> None:
    _, robust = _robust(write_oven(tmp_path, stay=70, heat="{from: 60 s, to: 75 s}"))
    lines = list(robustness_lines(robust, "s"))
    assert lines[0] == (
        "Not robust: no policy keeps all windows whatever happens in the ranges. "
        "These do not go together; 5 s are missing:"
    )
    assert "  - bread stays in oven for at most 70 s: 5 s more" in lines
    _, robust = _robust(write_oven(tmp_path, stay=75, heat="{from: 60 s, to: 75 s}"))
    assert list(robustness_lines(robust, "s")) == [
        "Robust: with 2 steps of uncertain duration, a policy with 0 waits keeps 1 window "
        "whatever happens. All has ended after 99 s at the latest.",
        "Without the policy, all windows are kept with a chance of 96.6 %.",
    ]
    other = replace(robust, kept=0.5, notes=(LONGEST_ORDER,))
    assert list(robustness_lines(other, "s"))[1:] == [
        "Without the policy, all windows are kept with a chance of 50.0 %.",
        "For this, the order is the one for the longest durations.",
    ]


def test_deadlines_count(tmp_path: Path) -> None:
    late = write_oven(tmp_path, stay=90, heat="{from: 60 s, to: 75 s}", due=95)
    _, robust = _robust(late)
    assert not robust.is_robust
    assert "bread is due at 95 s" in robust.cycle
    assert robust.lacks == 4
    _, robust = _robust(write_oven(tmp_path, stay=90, heat="{from: 60 s, to: 75 s}", due=99))
    assert robust.is_robust


def test_without_ranges_a_plan_is_robust_if_it_keeps_its_windows(tmp_path: Path) -> None:
    _, robust = _robust(write_oven(tmp_path, stay=75, heat="70 s", load="10 s"))
    assert robust.is_robust
    assert robust.varying == 0
