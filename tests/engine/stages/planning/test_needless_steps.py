"""Plans with quantities: no step that they can do without, and stages that another order of the
steps reaches sooner.
"""

import random
import tempfile
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from cellwright.engine.kernels.bits import bitset
from cellwright.engine.model.ground_task import GroundOperator, GroundTask
from cellwright.engine.model.workflow_replay import (
    operators_by_instance,
    reached_goals,
    replay_instances,
)
from cellwright.engine.pipelines.planning.plan_files import check_plan
from cellwright.engine.pipelines.planning.timetable.block_schedule import operators_of
from cellwright.engine.stages.grounding import ground
from cellwright.engine.stages.planning.action_elimination import achieved_goal, without_needless
from cellwright.engine.stages.planning.effect_variants import plain_steps
from cellwright.engine.stages.planning.improvement.batch_reduction import (
    needed_steps,
    reduce_batches,
)
from cellwright.engine.stages.planning.improvement.plan_reordering import deorder_steps
from cellwright.engine.stages.planning.search_control import Effort
from cellwright.kb.asp import ground_term
from cellwright.kb.loader import load_problem
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Function

DOMAIN = """
domain: sealing
types: {plate: object}
quantities:
  foils: 0..9
fluents:
  sealed(plate): {}
events:
  dosed(plate): {}
operators:
  seal(Plate):
    preconditions: not sealed(Plate), foils >= 1
    adds: sealed(Plate)
    decrease: {foils: 1}
    resources: sealer
    duration: 12 s
  unseal(Plate):
    preconditions: sealed(Plate)
    deletes: sealed(Plate)
    resources: sealer
    duration: 20 s
  dose(Plate):
    preconditions: not sealed(Plate)
    adds: dosed(Plate)
    resources: pipettor, Plate
    duration: 4 s
"""
PROBLEM = """
problem: one
domain: sealing
objects: {plate: [p, q]}
initial: [foils(9)]
workflow:
  - for: {P: [p, q]}
    stages: dosed(P), sealed(P)
"""
ROUNDABOUT = (
    "seal(p)",
    "unseal(p)",
    "dose(p)",
    "seal(p)",
    "seal(q)",
    "unseal(q)",
    "dose(q)",
    "seal(q)",
)


@pytest.fixture
def problem(tmp_path: Path) -> Problem:
    (tmp_path / "problems").mkdir()
    (tmp_path / "domain.yaml").write_text(DOMAIN, "utf-8")
    (tmp_path / "problems" / "one.yaml").write_text(PROBLEM, "utf-8")
    return load_problem(tmp_path / "problems" / "one.yaml")


def steps_of(task: GroundTask, said: tuple[str, ...]) -> list[GroundOperator]:
    names = [term for each in said if isinstance(term := ground_term(each), Function)]
    found = replay_instances(task, operators_by_instance(task), task.initial, names)
    assert found is not None
    return found


def names(steps: list[GroundOperator]) -> list[str]:
    return [str(step.instance) for step in steps if not step.instance.name.startswith("_")]


def test_steps_are_needless_though_others_follow_their_quantities(problem: Problem) -> None:
    task = ground(problem)
    left = without_needless(task, steps_of(task, ROUNDABOUT), Effort(1 << 30))
    assert names(left) == ["dose(p)", "seal(p)", "dose(q)", "seal(q)"]


def test_without_effort_no_step_is_dropped(problem: Problem) -> None:
    task = ground(problem)
    left = without_needless(task, steps_of(task, ROUNDABOUT), Effort(0, most=0))
    assert names(left) == list(ROUNDABOUT)


def test_where_a_stage_must_wait_the_steps_stay_as_they_are(problem: Problem) -> None:
    task = ground(problem)
    found = steps_of(task, ("dose(p)", "seal(p)", "dose(q)", "seal(q)"))
    steps = [each for each in found if str(each.instance) != '_reaches("1:p", 2)']
    state = task.initial
    for step in steps:
        state = task.after(state, step)
    here = (
        bitset([n for n, atom in enumerate(task.atoms) if atom.name in ("_stage", "sealed")])
        & state
    )
    waiting = replace(task, goals=(here,))  # p is sealed, and its stage is not reached
    assert needed_steps(waiting, steps, Effort(1 << 30)) == steps


def test_another_order_may_reach_a_stage_with_an_earlier_step(problem: Problem) -> None:
    task = ground(problem)
    made = plain_steps(task, steps_of(task, ROUNDABOUT[:4] + ROUNDABOUT[6:]))
    steps, goals = operators_of(task, deorder_steps(task, made, achieved_goal(task, made)))
    order = [2, 0, 1, 3, 4, 5]  # p is dosed before it is sealed for the first time
    assert [str(steps[n].instance) for n in order[:4]] == [
        "dose(p)",
        "seal(p)",
        "unseal(p)",
        "seal(p)",
    ]
    plan = deorder_steps(task, [steps[n] for n in order], goals, [100 * n for n in range(6)])
    assert check_plan(problem, plan) == []


@given(st.integers(0, 10_000))
@settings(max_examples=40, deadline=None)
def test_whatever_is_dropped_from_a_walk_to_the_goals_leaves_one(seed: int) -> None:
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "problems").mkdir()
        (Path(folder) / "domain.yaml").write_text(DOMAIN, "utf-8")
        (Path(folder) / "problems" / "one.yaml").write_text(PROBLEM, "utf-8")
        task = ground(load_problem(Path(folder) / "problems" / "one.yaml"))
    walk, state, chance = list[GroundOperator](), task.initial, random.Random(seed)
    while reached_goals(task, state) is None and len(walk) < 60:
        able = [each for each in task.operators if not each.preconditions & ~state]
        assume(bool(able))
        walk.append(chance.choice(able))
        state = task.after(state, walk[-1])
    assume(reached_goals(task, state) is not None)
    for steps in reduce_batches(task, walk, Effort(3000)):
        state = task.initial
        for step in steps:
            assert not step.preconditions & ~state
            state = task.after(state, step)
        assert reached_goals(task, state) is not None
