"""Measurements that no arm can take are told before anything moves, each with its reason;
everything else is planned.
"""

import io
from dataclasses import replace
from pathlib import Path

import pytest
from rich.console import Console

from cellwright.engine.formats.report.plans import plan_answer
from cellwright.engine.model.motion_values import MovedStep, Unmoved
from cellwright.engine.model.outcome import Found, Infeasible
from cellwright.engine.pipelines.execution import (
    RunRequest,
    RunScope,
    TimedOrders,
    begin_run,
    name_run,
    resume_run,
)
from cellwright.engine.pipelines.execution.run_start import added_knowledge, with_knowledge
from cellwright.engine.pipelines.motion.moving_plan import plan_moving, plan_with_poses
from cellwright.engine.pipelines.motion.plan_walk import PlanWalk, operation_of
from cellwright.engine.pipelines.planning import plan_objective
from cellwright.engine.pipelines.planning.checked_plan import problem_of
from cellwright.engine.pipelines.planning.goal_selection import all_lost, drop_unreachable_goals
from cellwright.engine.pipelines.planning.plan_gate import PlanGate
from cellwright.engine.plugins import geometry_backend
from cellwright.engine.stages.planning import SearchLimits
from cellwright.kb.asp import ground_term
from cellwright.kb.loader import load_problem
from cellwright.kb.loader.cell import cell_of
from cellwright.kb.model.body_shapes import Box, PlacedShape, Pose
from cellwright.kb.model.cell_model import Body, BodyKind, Cell, Placement
from cellwright.kb.model.conditions import goal_parts
from cellwright.kb.model.plan_model import Step, StepId
from cellwright.kb.model.planning_problem import Chain, Problem
from cellwright.kb.terms import Function

HEAD = "problem: few\ndomain: bulkhead\nobjects:\n  measurement: [a1..3]\nstatics:\n"
POINTS = {
    "a1": (-0.2, -0.5, -1),
    "a2": (0.2, 0.5, -1),
    "a3": (0.3, 0.15, -1),
}  # x, y (m), and the normal along z
UNREACHED = {
    "too far away": {"a2": (0.2, 6.0, -1)},
    "from behind": {"a1": (-0.2, -0.5, 1)},
    "both": {"a1": (-0.2, -0.5, 1), "a2": (0.2, 6.0, -1)},
}


def term(text: str) -> Function:
    """The ground term in a text."""
    found = ground_term(text)
    assert isinstance(found, Function)
    return found


def few(folder: Path, **elsewhere: tuple[float, float, int]) -> str:
    """A problem file with three points, some of them elsewhere."""
    lines = []
    for name, (x, y, z) in (POINTS | elsewhere).items():
        lines += [
            f"needs({name}, thickness)",
            f"position({name}, {round(x * 1e6)}, {round(y * 1e6)}, 0)",
        ]
        lines += [f"normal({name}, 0, 0, {z * 1000})"]
    goals = "goals:\n" + "".join(f"  - measured(_, _, meas({name}))\n" for name in POINTS)
    path = folder / "few.yaml"
    path.write_text(HEAD + "".join(f"  - {line}\n" for line in lines) + goals)
    return str(path)


def moving(problem: Problem, cell: Cell) -> tuple[set[str], dict[str, str], bool]:
    """The points that are measured, those that are given up with the reasons, and whether all
    paths are proved.
    """
    made = plan_with_poses(
        problem,
        cell,
        geometry_backend(),
        lambda each: plan_objective.plan_for_objective(each, SearchLimits()),
    ).moving
    assert isinstance(made.run.outcome, Found)
    steps = made.run.outcome.plan.steps
    done = {str(step.operator.arguments[2]) for step in steps if step.operator.name == "us_measure"}
    lost = {each.goal.partition("meas(")[2].partition(")")[0]: each.why for each in made.given_up}
    return done, lost, all(each.proved for each in made.steps)


@pytest.mark.slow
@pytest.mark.parametrize("way", UNREACHED)
def test_each_point_out_of_reach_is_told_and_the_others_are_measured(
    way: str, tmp_path: Path
) -> None:
    target = few(tmp_path, **UNREACHED[way])
    done, lost, proved = moving(problem_of(target), cell_of(target))
    assert set(lost) == set(UNREACHED[way])
    assert done == set(POINTS) - set(lost)
    assert all(lost.values())
    assert proved


@pytest.mark.slow
def test_a_point_behind_an_obstacle_is_told_with_the_obstacle(tmp_path: Path) -> None:
    target = few(tmp_path)
    cell = cell_of(target)
    x, y, _ = POINTS["a1"]
    placement = Placement("bulkhead", Pose((x, y, -0.1), (0.0, 0.0, 0.0)))
    block = Body("block", BodyKind.FIXTURE, placement, (PlacedShape(Box((0.1, 0.1, 0.1))),))
    done, lost, _ = moving(
        problem_of(target), replace(cell, bodies={**cell.bodies, "block": block})
    )
    assert set(lost) == {"a1"}
    assert "block" in lost["a1"]
    assert done == {"a2", "a3"}


class Killed(BaseException):
    """The process is gone."""


@pytest.mark.slow
def test_a_run_with_motion_goes_on_with_what_was_found_out_before_it(tmp_path: Path) -> None:
    target = few(tmp_path, **UNREACHED["too far away"])
    told = problem_of(target)
    made = plan_with_poses(
        told,
        cell_of(target),
        geometry_backend(),
        lambda each: plan_objective.plan_for_objective(each, SearchLimits()),
    ).moving
    wanted = name_run(RunRequest(target, store=str(tmp_path / "j.db")), told)
    whole = replace(made.problem, goal=told.goal)
    done = 0

    def kill(record: object) -> None:
        nonlocal done
        done += getattr(record, "kind", None) == "done"
        if done == 5:
            raise Killed

    with pytest.raises(Killed):
        begin_run(
            wanted,
            whole,
            TimedOrders(),
            [kill],
            table=made.run.timetable,
            scope=RunScope(made.problem, made.given_up),
        )
    ending = resume_run(wanted.store, wanted.run, TimedOrders())
    assert (ending.outcome, len(ending.goals), len(ending.open_goals)) == ("partly", 2, 1)
    assert "out of the reach" in ending.given_up[0][1]
    assert isinstance(made.run.outcome, Found)
    assert ending.steps == len(made.run.outcome.plan.steps)
    assert ending.makespan_ms == ending.forecast_ms


def test_goals_about_nothing_that_is_lost_stay() -> None:
    problem = load_problem("bulkhead/twelve_points")
    left, given_up = drop_unreachable_goals(problem, {"m3": "it is too far", "m7": "it is behind"})
    assert [each.why for each in given_up] == ["it is too far", "it is behind"]
    gone = set(goal_parts(problem.goal)) - set(goal_parts(left.goal))
    assert {str(part) for part in gone} == {each.goal for each in given_up}


def test_where_everything_is_lost_the_problem_stays() -> None:
    problem = load_problem("bulkhead/one_point")
    lost = {f"m{n}": "it is too far" for n in range(1, 13)}
    assert drop_unreachable_goals(problem, lost) == (problem, ())
    assert [each.why for each in all_lost(problem, lost)] == ["it is too far"]


def test_where_nothing_can_be_taken_the_answer_says_so_and_sends_nobody_to_explain() -> None:
    problem = load_problem("bulkhead/one_point")
    lost = {f"m{n}": "it is too far" for n in range(1, 13)}
    made = plan_moving(problem, cell_of("bulkhead"), geometry_backend(), no_plan, lost=lost)
    assert made.run.outcome == Infeasible(
        "no arm can take any of the measurements that are asked for"
    )
    console = Console(file=io.StringIO(), width=200)
    console.print(
        plan_answer.plan_answer_text(
            plan_answer.PlanAnswer(made.run, problem, {}, made), False, False
        )
    )
    said = console.file.getvalue()
    assert "it is too far" in said
    assert "cellwright explain" not in said


def no_plan(_: Problem) -> plan_objective.Run:
    return plan_objective.Run(Infeasible("there is none"))


def test_what_waits_for_a_lost_measurement_no_longer_waits() -> None:
    problem = problem_of("bulkhead/twelve_points", "", "measure m1, then m2, then m3")
    left, given_up = drop_unreachable_goals(problem, {"m2": "it is too far"})
    assert {each.why for each in given_up} == {"it is too far"}
    assert [chain.stages for chain in left.chains] == [problem.chains[n].stages for n in (0, 2)]
    assert all(not chain.after for chain in left.chains)


def test_a_chain_ends_before_its_first_stage_that_is_lost() -> None:
    problem = problem_of("bulkhead/twelve_points", "", "measure m1, then m2, then m3")
    whole = Chain("all", tuple(stage for chain in problem.chains for stage in chain.stages))
    left, given_up = drop_unreachable_goals(
        replace(problem, chains=(whole,)), {"m2": "it is too far"}
    )
    assert [chain.stages for chain in left.chains] == [whole.stages[:1]]
    assert [each.why for each in given_up][-2:] == [
        "it is too far",
        f"it comes after {whole.stages[1]}",
    ]


def test_what_was_found_out_survives_the_journal() -> None:
    told = load_problem("bulkhead/three_stations")
    fact = Function("serves", (Function("left"), Function("b1")))
    step = Function("move_retract", (Function("t3_746"), Function("a1")))
    known = replace(told, statics=(*told.statics, fact), durations={step: 7})
    assert with_knowledge(told, added_knowledge(told, known)) == known
    assert added_knowledge(told, told) == {}


def taken(
    walk: PlanWalk, text: str, before: frozenset[Function], after: frozenset[Function]
) -> object:
    """What comes of one step of the arm."""
    operation = operation_of(walk.cell, term(text))
    assert operation is not None
    return walk.step(Step(StepId(1), term(text)), operation, before, after)


def test_a_step_to_where_a_scanner_sees_nothing_is_refused_with_what_hides_the_point() -> None:
    problem, cell = problem_of("bulkhead/twelve_points"), cell_of("bulkhead/twelve_points")
    before = frozenset({term("location(slra, t3_746, in_rack)"), term("stands(t3_746, middle)")})
    holding = frozenset({term("holding(t3_746, slra)"), term("stands(t3_746, middle)")})
    plate = PlacedShape(Box((0.3, 0.3, 0.01)))
    screen = Body(
        "screen", BodyKind.FIXTURE, Placement("bulkhead", Pose((0.0, -0.5, -0.04))), (plate,)
    )
    answers = []
    for each in (cell, replace(cell, bodies={**cell.bodies, "screen": screen})):
        walk = PlanWalk(PlanGate().semantics(problem), each, geometry_backend())
        assert isinstance(taken(walk, "pick_up(t3_746, slra)", before, holding), MovedStep)
        answers.append(taken(walk, "move(t3_746, rack(slra), meas(m4))", holding, holding))
    assert isinstance(answers[0], MovedStep)
    assert isinstance(answers[1], Unmoved)
    assert (answers[1].level, answers[1].culprits, answers[1].sure) == ("sight", ("screen",), True)
    assert "screen is between it and the laser and camera of slra" in answers[1].reason
