"""Inspections in simulation with a hidden truth: the part is found, bad values are repeated,
and a stopped run goes on with what it knew.
"""

import json
import random
import re
from pathlib import Path

import numpy as np
import pytest

from cellwright.engine.kernels.rigid import apply, difference, rotation_by_vector, transform
from cellwright.engine.model.run_protocol import Finish, OperatorCommand, RecordKind
from cellwright.engine.pipelines.execution import (
    GivenOrder,
    RunRequest,
    RunScope,
    TimedOrders,
    begin_run,
    name_run,
    resume_run,
)
from cellwright.engine.pipelines.execution.run_results import survey_of
from cellwright.engine.pipelines.planning.checked_plan import problem_of
from cellwright.engine.pipelines.planning.goal_selection import drop_unreachable_goals
from cellwright.engine.pipelines.simulators.true_part import displacement_of, read_truth
from cellwright.kb.asp import ground_term
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.loader import load
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.store.journal import Journal, JournalLine
from cellwright.kb.terms import Function
from tests.places import BUNDLED

SHIFT_MM, TURN_DEG = [12.0, -20.0, 9.0], [1.5, -2.0, 3.0]
TRUE = transform(rotation_by_vector(np.radians(TURN_DEG)), 1e-3 * np.array(SHIFT_MM))
DATUMS, POINTS = 15, 9


def job(folder: Path, bad: dict[str, float]) -> Path:
    """Datums on three sides of a block and points on its top; the truth beside it."""
    chance = random.Random(5)
    lines = ["problem: block", f"domain: {BUNDLED / 'bulkhead'}"]
    lines += [
        f"objects: {{measurement: [d1..{DATUMS}, p1..{POINTS}]}}",
        "statics:",
        "  - uncertainty(slra, 40)",
    ]
    for n in range(1, DATUMS + 1):
        at = [round(1e6 * chance.uniform(-0.5, 0.5)) for _ in range(3)]
        normal = [1000 * (axis == n % 3) for axis in range(3)]
        lines += [f"  - needs(d{n}, profile)", f"  - alignment(d{n}, 1)"]
        lines += [f"  - position(d{n}, {at[0]}, {at[1]}, {at[2]})"]
        lines += [f"  - normal(d{n}, {normal[0]}, {normal[1]}, {normal[2]})"]
    for n in range(1, POINTS + 1):
        lines += [f"  - needs(p{n}, profile)", f"  - nominal(p{n}, 0)", f"  - tolerance(p{n}, 400)"]
        lines += [
            f"  - position(p{n}, {100_000 * (n % 3)}, {100_000 * (n // 3)}, 0)",
            f"  - normal(p{n}, 0, 0, 1000)",
        ]
    names = [*(f"d{n}" for n in range(1, DATUMS + 1)), *(f"p{n}" for n in range(1, POINTS + 1))]
    lines += ["goals:", *(f"  - measured(_, _, meas({name}))" for name in names), ""]
    (folder / "job.yaml").write_text("\n".join(lines))
    values = {f"p{n}": 50.0 for n in range(1, POINTS + 1)}
    truth = {
        "shift_mm": SHIFT_MM,
        "turn_deg": TURN_DEG,
        "values": values,
        "noise": {"slra": 20},
        "bad": bad,
    }
    (folder / "truth.json").write_text(json.dumps(truth))
    return folder / "job.yaml"


def inspected(
    folder: Path, orders: TimedOrders, bad: dict[str, float]
) -> tuple[Finish, list[JournalLine], str]:
    target, store = job(folder, bad), str(folder / "runs.db")
    problem = load(target).problem
    assert problem is not None
    wanted = RunRequest(
        str(target), store=store, run="one", options={"truth": str(folder / "truth.json")}
    )
    ending = begin_run(name_run(wanted, problem), problem, orders)
    assert isinstance(ending, Finish)
    return ending, lines_of(store), store


def lines_of(store: str) -> list[JournalLine]:
    with Journal(store) as journal:
        return list(journal.lines("one"))


BAD = {"d4": 4000.0, "p5": -600.0}


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> tuple[Finish, list[JournalLine], str]:
    return inspected(tmp_path_factory.mktemp("inspected"), TimedOrders(), BAD)


def test_the_part_is_found_before_anything_else_is_measured(
    run: tuple[Finish, list[JournalLine], str],
) -> None:
    ending, lines, _ = run
    assert ending.outcome == "reached"
    told = [line for line in lines if line.kind == RecordKind.ALIGNMENT.value]
    measured = [line for line in lines if line.kind == RecordKind.RESULT.value]
    assert len(told) == 1
    assert {line.content["of"] for line in measured if line.number < told[0].number} == {
        f"d{n}" for n in range(1, DATUMS + 1)
    }
    T = displacement_of(told[0].content["part"])
    assert np.linalg.norm(apply(T, np.zeros((1, 3))) - apply(TRUE, np.zeros((1, 3)))) < 1e-4
    assert np.degrees(difference(T, TRUE)[1]) < 0.02
    assert told[0].content["wrong"] == ["d4"]


def test_every_command_behind_the_datums_says_where_the_part_lies(
    run: tuple[Finish, list[JournalLine], str],
) -> None:
    _, lines, _ = run
    told = next(line for line in lines if line.kind == RecordKind.ALIGNMENT.value)
    sent = [line for line in lines if line.kind == RecordKind.COMMAND.value]
    assert all(
        line.content["part"] == told.content["part"] for line in sent if line.number > told.number
    )
    assert not any("part" in line.content for line in sent if line.number < told.number)


def test_bad_values_are_repeated_and_left_out(run: tuple[Finish, list[JournalLine], str]) -> None:
    survey = survey_of(run[2], "one").survey
    assert survey is not None
    features = {each.of: each for each in survey.features}
    assert {name for name, each in features.items() if each.bad} == set(BAD)
    assert not survey.unmeasured
    assert survey.counts() == {"not judged": DATUMS, "conforming": POINTS}
    assert all(
        abs((each.value or 0.0) - 50.0) < 120 for name, each in features.items() if name[0] == "p"
    )


@pytest.mark.slow
def test_a_run_that_is_stopped_goes_on_where_the_part_lies(tmp_path: Path) -> None:
    _, whole, _ = inspected(made_in(tmp_path, "whole"), TimedOrders(), BAD)
    found = next(line for line in whole if line.kind == RecordKind.ALIGNMENT.value)
    for name, at_ms in (("before", found.at_ms - 2_000), ("behind", found.at_ms + 25_000)):
        folder = made_in(tmp_path, name)
        stopped, _, store = inspected(
            folder, TimedOrders([(at_ms, GivenOrder(OperatorCommand.STOP))]), BAD
        )
        assert stopped.outcome == "stopped"
        ending = resume_run(store, "one", TimedOrders())
        assert ending.outcome == "reached"
        lines = lines_of(store)
        told = [line.content["part"] for line in lines if line.kind == RecordKind.ALIGNMENT.value]
        assert len(told) == 1
        assert lines[-2].content.get("part", told[0]) == told[0]
        survey = survey_of(store, "one").survey
        assert survey is not None
        assert survey.counts() == {"not judged": DATUMS, "conforming": POINTS}


def made_in(parent: Path, name: str) -> Path:
    (parent / name).mkdir()
    return parent / name


@pytest.mark.slow
def test_datums_that_fit_nowhere_are_a_case_for_the_fault_base(tmp_path: Path) -> None:
    chance = random.Random(2)
    bad = {f"d{n}": chance.choice([-1, 1]) * chance.uniform(5_000, 90_000) for n in range(1, 10)}
    ending, lines, _ = inspected(tmp_path, TimedOrders(), bad)
    told = [line for line in lines if line.kind == RecordKind.ALIGNMENT.value]
    assert told[0].content["part"] == []
    assert "fits more than" in told[0].content["why"]
    case = next(line for line in lines if line.kind == RecordKind.EXCEPTION.value)
    assert case.content["exception"] == "alignment_fails"
    assert ending.exceptions == 1 or ending.story


def test_a_truth_gives_what_the_beam_meets(tmp_path: Path) -> None:
    target = job(tmp_path, {"p1": 7.0})
    problem = load(target).problem
    assert problem is not None
    truth = read_truth(str(tmp_path / "truth.json"), problem, 0)
    truth.noise = {}
    rows = [float(each) for each in TRUE[:3].ravel()]
    step = ground_term("laser_measure(slra, t3_746, p1)")
    assert isinstance(step, Function)
    assert [truth.value(step, rows) for _ in range(2)] == ["57", "50"]
    assert abs(int(truth.value(step) or "0")) > 5_000


@pytest.mark.parametrize(
    "text",
    ["", "[]", '{"shift": [1]}', '{"shift_mm": [1]}', '{"noise": {"a": "b"}}', '{"bad": []}'],
)
def test_a_file_that_is_no_truth_is_refused(tmp_path: Path, text: str) -> None:
    problem: Problem | None = load(job(tmp_path, {})).problem
    assert problem is not None
    (tmp_path / "truth.json").write_text(text)
    with pytest.raises(InvalidInput) as error:
        read_truth(str(tmp_path / "truth.json"), problem, 0)
    assert [each.code for each in error.value.diagnostics] == ["K413"]


def test_datums_that_cannot_hold_the_part_are_refused_before_anything_is_measured(
    tmp_path: Path,
) -> None:
    target = job(tmp_path, {})
    # no datums but those that look along x and y
    text = target.read_text().replace("alignment(d", "near(d")
    datums = [f"  - alignment(d{n}, 1)" for n in range(1, DATUMS + 1) if n % 3 != 2]
    lines = [line for line in text.splitlines() if "near(d" not in line]
    at = lines.index("statics:") + 1
    target.write_text("\n".join([*lines[:at], *datums, *lines[at:], ""]))
    problem = load(target).problem
    assert problem is not None
    wanted = RunRequest(str(target), store=str(tmp_path / "runs.db"), run="one")
    with pytest.raises(InvalidInput) as refused:
        begin_run(name_run(wanted, problem), problem, TimedOrders())
    (said,) = refused.value.diagnostics
    assert said.message == "the datums leave a shift along (0.00, 0.00, 1.00) free"
    helpers = re.findall(r"alignment\((\w+), 1\)", said.hint or "")
    assert len(helpers) == 3
    assert all(name.startswith(("p", "d2", "d5", "d8", "d11", "d14")) for name in helpers)


def test_what_was_given_up_before_the_run_is_told_with_its_reason_before_what_no_goal_asks_for(
    tmp_path: Path,
) -> None:
    target, store = job(tmp_path, {}), str(tmp_path / "runs.db")
    goals = "measured(_, _, meas(p2)), measured(_, _, meas(p5))"
    told = problem_of(str(target), goals)
    left, given_up = drop_unreachable_goals(told, {"p5": "the jig is in the way"})
    asked = name_run(RunRequest(str(target), goals, store=store), told)
    begin_run(asked, left, TimedOrders(), scope=RunScope(left, given_up))
    shown = survey_of(store, asked.run).survey
    assert shown is not None
    assert [each.of for each in shown.features] == ["p2"]
    first, second, *_ = shown.unmeasured
    assert (first.name, first.why) == ("p5", "the jig is in the way")
    assert second.why == "no goal asks for it"
