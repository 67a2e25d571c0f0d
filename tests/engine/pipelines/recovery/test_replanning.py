"""After a diagnosis the plan that failed is revised before anything is planned anew; what is
lost goes to the sequence.
"""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from cellwright.engine.faces.cli import app
from cellwright.engine.model.outcome import Found, Infeasible
from cellwright.engine.model.troubleshooting import Revision
from cellwright.engine.pipelines.inspection.tour_progress import SequenceNews
from cellwright.engine.pipelines.planning import checked_plan, plan_objective
from cellwright.engine.pipelines.planning.decomposition.kept_sequences import (
    carry_on,
    told_of_losses,
)
from cellwright.engine.pipelines.recovery.diagnosis_case import recover_goals, state_after
from cellwright.engine.pipelines.recovery.remaining_problem import rest_after_steps
from cellwright.engine.stages.validation.operator_semantics import Semantics
from cellwright.kb.asp import ground_term
from cellwright.kb.loader import load
from cellwright.kb.loader.plan import load_plan
from cellwright.kb.model.plan_model import Plan
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Function

POINTS = "name,x,y,z,nx,ny,nz,kind\na,0,0,0,0,0,1,profile\nc,20,0,0,0,0,1,thickness\ng,50,0,0,0,0,1,thickness\n"
START = "initial:\n  - at(t3_746, approach_point(rack(us_probe)))\n"


def run(*arguments: str) -> tuple[int, str]:
    result = CliRunner().invoke(app, arguments)
    return result.exit_code, result.stdout


@pytest.fixture(scope="module")
def plate(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A problem of three points that can be planned for, its plan beside it."""
    file = tmp_path_factory.mktemp("plate") / "plate.yaml"
    table = file.with_suffix(".csv")
    table.write_text(POINTS)
    assert run("import", "qif", str(table), "--output", str(file))[0] == 0
    file.write_text(file.read_text() + START)
    file.with_suffix(".json").write_text(run("plan", str(file), "--format", "json")[1])
    return file


@pytest.fixture(scope="module")
def planned(plate: Path) -> tuple[Problem, Plan]:
    return load_plan(plate.with_suffix(".json"))


@pytest.fixture(scope="module")
def probes() -> tuple[Problem, Plan]:
    """A problem with a workflow."""
    problem = checked_plan.problem_of("themse/one")
    found = checked_plan.plan_problem(problem)
    assert isinstance(found, Found)
    return problem, found.plan


@pytest.mark.parametrize("kind", ["planned", "probes"])
@pytest.mark.parametrize("share", [0.0, 0.4, 0.9])
def test_where_nothing_changed_the_plan_that_failed_goes_on_as_it_was(
    kind: str, share: float, request: pytest.FixtureRequest
) -> None:
    problem, plan = request.getfixturevalue(kind)
    done = [step.id for step in plan.steps[: int(share * len(plan.steps))]]
    now, left = rest_after_steps(problem, plan, done)
    found = recover_goals(now, Revision(), left=left)
    assert found.way == "continued"
    assert isinstance(found.outcome, Found)
    assert not found.added
    assert not found.dropped
    assert not checked_plan.check_plan(found.problem, found.outcome.plan)


def test_what_is_left_begins_in_the_state_that_the_steps_done_lead_to(
    planned: tuple[Problem, Plan],
) -> None:
    problem, plan = planned
    for count in range(len(plan.steps) + 1):
        now, left = rest_after_steps(problem, plan, [step.id for step in plan.steps[:count]])
        start = frozenset(Semantics(problem).initial())
        assert frozenset(now.initial) == state_after(problem, start, Plan(plan.steps[:count]))
        assert [step.operator for step in left.steps] == [
            step.operator for step in plan.steps[count:]
        ]


def test_a_plan_whose_ground_is_gone_is_repaired_with_most_of_its_steps(
    planned: tuple[Problem, Plan],
) -> None:
    problem, plan = planned
    first = next(n for n, step in enumerate(plan.steps) if step.operator.name == "us_measure")
    now, left = rest_after_steps(problem, plan, [step.id for step in plan.steps[:first]])
    point = plan.steps[first].operator.arguments[-1]
    dry = ground_term(f"couplant_applied(goal_point(meas({point})))")
    assert isinstance(dry, Function)
    found = recover_goals(now, Revision(withdrawn=((dry, "it is dry"),)), left=left)
    assert found.way == "repaired"
    assert isinstance(found.outcome, Found)
    assert "apply_couplant" in [step.operator.name for step in found.added]
    assert len(found.kept) > len(found.dropped)
    assert not checked_plan.check_plan(found.problem, found.outcome.plan)
    anew = recover_goals(now, Revision(withdrawn=((dry, "it is dry"),)))
    assert anew.way == "planned"
    assert isinstance(anew.outcome, Found)


def test_steps_that_need_what_is_lost_are_not_taken_again(planned: tuple[Problem, Plan]) -> None:
    problem, plan = planned
    last = max(n for n, step in enumerate(plan.steps) if step.operator.name.endswith("measure"))
    needed = str(plan.steps[last].operator.arguments[0])
    (spare,) = {"us_probe", "slra"} - {needed}
    now, left = rest_after_steps(problem, plan, [step.id for step in plan.steps[:last]])
    assert isinstance(recover_goals(now, Revision(lost=(needed,)), left=left).outcome, Infeasible)
    found = recover_goals(now, Revision(lost=(spare,)), left=left)
    assert isinstance(found.outcome, Found)
    assert found.way == "continued"
    assert [step.operator for step in found.kept] == [step.operator for step in left.steps]


@pytest.mark.slow
def test_a_kept_sequence_is_told_what_was_lost_and_what_the_plan_has_done(
    plate: Path, planned: tuple[Problem, Plan], tmp_path: Path
) -> None:
    store = str(tmp_path / "s.db")
    assert run("sequence", str(plate), "--store", store)[0] == 0
    measured = [n for n, step in enumerate(planned[1].steps) if step.operator.name == "us_measure"]
    step = str(planned[1].steps[measured[-1]].operator)
    case = [
        "diagnose",
        str(plate),
        "--exception",
        "no_echo",
        "--step",
        step,
        "--hidden",
        "broken_probe",
    ]
    plan = ["--recover", "--plan", str(plate.with_suffix(".json"))]
    code, out = run(*case, *plan, "--store", store, "--format", "json")
    assert code == 0, out
    recovery = json.loads(out)["data"]["recovery"]
    last = step.rstrip(")").split(", ")[-1]
    assert recovery["way"] == "replanned"
    open_ = any(each.operator.name == "laser_measure" for each in planned[1].steps[measured[-1] :])
    assert recovery["status"] == ("optimal" if open_ else "infeasible")
    assert recovery["sequence"]["lost"] == ["us_probe"]
    assert list(recovery["sequence"]["changes"]["dropped"]) == [last]
    before = [
        each.operator
        for each in planned[1].steps[: measured[-1]]
        if each.operator.name.endswith("measure")
    ]
    assert sorted(recovery["sequence"]["done"]) == sorted(
        str(each.arguments[-1]) for each in before
    )
    assert json.loads(run("sequence", str(plate), "--store", store, "--format", "json")[1])["data"][
        "lost"
    ] == ["us_probe"]


def test_without_a_kept_sequence_nobody_is_told(plate: Path, tmp_path: Path) -> None:
    problem = load(plate).problem
    assert problem is not None
    store = str(tmp_path / "s.db")
    assert told_of_losses(store, problem, ["us_probe"]) is None
    carry_on(store, problem, SequenceNews())
    told = told_of_losses(store, problem, ["us_probe", "patience"])
    assert told is not None
    assert told.plan.lost == ("us_probe",)


@pytest.mark.parametrize(
    "wrong",
    [
        ["bulkhead/one_point", "--step", "us_measure(us_probe, t3_746, m2)"],
        ["PLATE", "--done", "99"],
        ["PLATE", "--done", "1, 17"],
        ["PLATE", "--step", "us_measure(us_probe, t3_746, a)"],
        ["PLATE"],
    ],
)
def test_a_plan_for_another_problem_and_steps_that_are_not_in_it_are_refused(
    plate: Path, wrong: list[str]
) -> None:
    target, *others = [str(plate) if each == "PLATE" else each for each in wrong]
    plan = str(plate.with_suffix(".json"))
    given = ["--exception", "no_echo", "--hidden", "broken_probe", "--recover", "--plan", plan]
    assert run("diagnose", target, *given, *others)[0] == 2


@pytest.mark.slow
def test_measurements_that_are_open_again_are_made_in_the_order_of_the_sequencer() -> None:
    problem = checked_plan.problem_of("bulkhead/twelve_points")
    first = plan_objective.plan_for_objective(problem).outcome
    assert isinstance(first, Found)
    half = [step.id for step in first.plan.steps[: len(first.plan.steps) // 2]]
    now, left = rest_after_steps(problem, first.plan, half)
    doubted = tuple((each, "the part has moved") for each in now.initial if each.name == "measured")
    assert len(doubted) > 1
    found = recover_goals(now, Revision(withdrawn=doubted), left=left)
    anew = plan_objective.plan_for_objective(found.problem).outcome
    assert isinstance(found.outcome, Found)
    assert isinstance(anew, Found)
    assert found.way == "replanned"
    assert seconds(found.outcome.plan) == seconds(anew.plan)


def seconds(plan: Plan) -> int:
    """How long the steps of one arm last, one after another."""
    return sum(step.duration for step in plan.steps)
