"""Several hands each have blocks of their own, and share out those that any of them can do."""

from collections.abc import Sequence
from itertools import combinations
from pathlib import Path

import pytest

from cellwright.engine.model.outcome import Found
from cellwright.engine.model.shop_scheduling import Timetable
from cellwright.engine.pipelines.planning.checked_plan import plan_and_ground, problem_of
from cellwright.engine.pipelines.planning.timetable import make_timetable
from cellwright.engine.pipelines.planning.timetable.block_schedule import (
    SCOPE_BLOCKS,
    operators_of,
    subjects_of,
)
from cellwright.engine.stages.planning import SearchLimits
from cellwright.engine.stages.scheduling import check_schedule
from cellwright.engine.stages.scheduling.arm_assignment import shared_out
from cellwright.engine.stages.scheduling.plan_blocks import (
    Unstructured,
    arm_resources,
    arms_to,
    cut_blocks,
)
from cellwright.engine.stages.validation import validate_plan
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Term

DOMAIN = """
domain: bakery
units: {time: s}
types: {hand: object, loaf: object, spot: object, oven: spot, tray: spot}
objects: {hand: HANDS, loaf: [loaf_1..LOAVES], oven: [oven], tray: [tray_1..LOAVES]}
fluents:
  at(loaf, spot): {}
  holding(hand, loaf): {}
  empty(hand): {}
  free(spot): {}
  baked(loaf): {}
defaults: [empty(Hand), free(Spot)]
operators:
  pick(Hand, Loaf, Spot):
    preconditions: at(Loaf, Spot), empty(Hand)
    adds: holding(Hand, Loaf)
    resources: Hand, Loaf
    duration: 5 s
  put(Hand, Loaf, Spot):
    preconditions: holding(Hand, Loaf), free(Spot)
    adds: at(Loaf, Spot)
    resources: Hand, Loaf
    duration: 5 s
  bake(Loaf, Oven):
    types: {Oven: oven}
    preconditions: at(Loaf, Oven)
    adds: baked(Loaf)
    resources: Loaf, Oven
    duration: 20 s
deductive_operators:
  - when: holding(Hand, Loaf)
    denies: at(Loaf, _); empty(Hand)
  - when: at(Loaf, Spot)
    denies: holding(_, Loaf); free(Spot)
  - when: not holding(Hand, Loaf)
    implies: empty(Hand)
  - when: not at(Loaf, Spot)
    implies: free(Spot)
"""


def bakery(folder: Path, hands: str, loaves: int) -> Problem:
    """Loaves that go from their trays into the one oven and back, by some hands."""
    text = DOMAIN.replace("HANDS", hands).replace("LOAVES", str(loaves))
    (folder / "domain.yaml").write_text(text)
    there = ", ".join(f'"at(loaf_{n}, tray_{n})"' for n in range(1, loaves + 1))
    chains = "".join(
        f'  - {{for: {{L: [loaf_{n}]}}, stages: "baked(L), at(L, tray_{n})"}}\n'
        for n in range(1, loaves + 1)
    )
    (folder / "problem.yaml").write_text(
        f"problem: day\ndomain: bakery\ninitial: [{there}]\nworkflow:\n{chains}"
    )
    return problem_of(str(folder / "problem.yaml"))


def made_of(problem: Problem) -> Timetable:
    made = make_timetable(problem)
    assert isinstance(made, Timetable)
    assert validate_plan(problem, made.plan) == []
    assert check_schedule(made.shop, made.schedule) == ()
    return made


def hands_of(made: Timetable) -> set[str]:
    return {
        str(step.operator.arguments[0]) for step in made.plan.steps if step.operator.name != "bake"
    }


def test_two_hands_are_sooner_done_than_one(tmp_path: Path) -> None:
    (tmp_path / "one").mkdir()
    one, two = (
        made_of(bakery(tmp_path / "one", "[left]", 3)),
        made_of(bakery(tmp_path, "[left, right]", 3)),
    )
    assert (one.scope, two.scope) == (SCOPE_BLOCKS, SCOPE_BLOCKS)
    assert one.schedule.makespan == 3 * 40  # in, baked, out, one after another
    assert two.schedule.makespan == 3 * 20 + 2 * 10 + 2 * 10  # one hand waits with the next loaf
    assert hands_of(two) == {"left", "right"}


def test_no_hand_does_two_steps_at_once(tmp_path: Path) -> None:
    made = made_of(bakery(tmp_path, "[left, right]", 3))
    for one, other in combinations(made.plan.steps, 2):
        if set(one.resources) & set(other.resources):
            first, second = sorted(
                (made.starts[s.id], made.starts[s.id] + s.duration) for s in (one, other)
            )
            assert first[1] <= second[0]


@pytest.mark.parametrize("hands", ["[left]", "[left, right]", "[left, middle, right]"])
def test_each_way_to_share_the_blocks_can_be_carried_out(tmp_path: Path, hands: str) -> None:
    problem = bakery(tmp_path, hands, 2)
    outcome, task = plan_and_ground(problem, SearchLimits())
    assert isinstance(outcome, Found)
    operators, _ = operators_of(task, outcome.plan)
    subjects = subjects_of(problem)
    arms = arms_to(operators, task.operators, subjects)
    assert sorted(map(str, arms)) == sorted(hands.strip("[]").split(", "))
    ways = list(shared_out(task, operators, subjects))
    assert len(ways) == (0 if len(arms) == 1 else 4 if len(arms) > 2 else 3)
    for way in ways:
        assert _followed(task.initial, way)
        blocks = cut_blocks(task, way, arm_resources(way, subjects), subjects)
        assert sum(len(each.steps) for each in blocks) == len(way)


def _followed(state: int, steps: Sequence[object]) -> bool:
    from cellwright.engine.model.ground_task import GroundOperator, progress_state

    for step in steps:
        assert isinstance(step, GroundOperator)
        if step.preconditions & ~state:
            return False
        state = progress_state(state, step)
    return True


def test_a_hand_that_is_never_free_again_has_no_blocks(tmp_path: Path) -> None:
    problem = bakery(tmp_path, "[left, right]", 2)
    outcome, task = plan_and_ground(problem, SearchLimits())
    assert isinstance(outcome, Found)
    operators, _ = operators_of(task, outcome.plan)
    arms: tuple[Term, ...] = arm_resources(operators, subjects_of(problem))
    with pytest.raises(Unstructured, match="not free at the end"):
        cut_blocks(task, operators[:-1], arms, subjects_of(problem))
