"""Runs that follow a policy: no window is broken, and a run that goes on keeps to it."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import pytest

from cellwright.engine.model.run_protocol import Finish, JournalRecord, RecordKind
from cellwright.engine.pipelines import execution, planning
from cellwright.engine.pipelines.execution.executable_plan import compile_ready_plan
from cellwright.engine.pipelines.execution.plan_records import compiled_of, plan_content
from cellwright.engine.pipelines.execution.run_goals import RunScope
from cellwright.engine.stages.execution import standing_of
from cellwright.engine.stages.execution.rule_following import allowed_start
from cellwright.kb import loader
from tests.engine.pipelines.planning.robustness.uncertain_cells import write_joining

CELL: Mapping[str, str] = {
    "load": "{from: 8 s, to: 12 s}",
    "long": "{from: 60 s, to: 120 s}",
    "short": "{from: 20 s, to: 24 s}",
}


def _run(problem_file: Path, options: Mapping[str, str], seed: int, robust: bool) -> list[str]:
    """What is told of stays that are too long in a run."""
    problem = loader.load_problem(problem_file)
    plain = planning.plan_for_objective(problem)
    run, answer = planning.make_robust(problem, plain)
    assert answer is not None
    told: list[str] = []

    def watch(record: JournalRecord) -> None:
        if record.kind is RecordKind.EXCEPTION:
            told.append(str(record.content.get("reply", "")))

    request = execution.RunRequest(
        str(problem_file), store=str(problem_file.with_name("j.db")), seed=seed, options=options
    )
    with execution.list_run(request, problem) as wanted:
        ending = execution.begin_run(
            wanted,
            problem,
            execution.TimedOrders([]),
            [watch],
            table=run.timetable if robust else plain.timetable,
            rules=answer.rules if robust else {},
        )
    assert isinstance(ending, Finish)
    assert ending.outcome == "reached"
    return told


@pytest.mark.parametrize("durations", ["shortest", "longest", "drawn"])
def test_a_run_with_a_policy_keeps_all_windows(tmp_path: Path, durations: str) -> None:
    cell = write_joining(tmp_path, stays=(200, 40), **CELL)
    assert _run(cell, {"durations": durations}, 7, robust=True) == []


def test_the_same_run_without_one_does_not(tmp_path: Path) -> None:
    cell = write_joining(tmp_path, stays=(200, 40), **CELL)
    assert _run(cell, {"durations": "longest"}, 7, robust=False) != []


def test_a_program_that_was_noted_has_the_same_rules(tmp_path: Path) -> None:
    problem = loader.load_problem(write_joining(tmp_path, stays=(200, 40), **CELL))
    run, answer = planning.make_robust(problem, planning.plan_for_objective(problem))
    assert answer is not None
    assert run.timetable is not None
    ready = compile_ready_plan(
        problem, run.timetable.plan, run.timetable.starts, 0, rules=answer.rules
    )
    again = compiled_of(plan_content(ready, "first", RunScope(problem))).program
    assert again.activities == ready.compiled.program.activities
    assert any(a.rule is not None and a.rule.waits for a in again.activities.values())


def test_what_waits_for_an_end_or_a_time_begins_at_the_sooner_of_both(tmp_path: Path) -> None:
    problem = loader.load_problem(write_joining(tmp_path, stays=(200, 40), **CELL))
    run, answer = planning.make_robust(problem, planning.plan_for_objective(problem))
    assert answer is not None
    assert run.timetable is not None
    program = compile_ready_plan(
        problem, run.timetable.plan, run.timetable.starts, 0, rules=answer.rules
    ).compiled.program
    waiting = next(a for a in program.activities.values() if a.rule and a.rule.waits)
    assert waiting.rule is not None
    ((awaited, time_ms),) = list(waiting.rule.waits.items())[:1]
    known = {**waiting.rule.starts, **waiting.rule.ends, awaited: 0}
    none = standing_of(program, 0, 1)
    assert allowed_start(program, none, waiting.rule) is None
    ends = dict.fromkeys((n for n in known if n != awaited), 0)
    before = standing_of(program, 0, 1, done=tuple(ends), ends=ends)
    begun = {**before.begun_ms, awaited: 0}
    under_way = replace(before, begun_ms=begun)
    start = allowed_start(program, under_way, waiting.rule)
    assert start is not None
    assert start >= time_ms
    over = replace(under_way, ended_ms={**before.ended_ms, awaited: 61_000})
    sooner = allowed_start(program, over, waiting.rule)
    assert sooner is not None
    assert sooner <= start
