"""A task that was grounded once serves the other problems of its cell as one that is grounded for
each of them.
"""

from pathlib import Path
from random import Random

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from cellwright.engine.model.ground_task import GroundTask
from cellwright.engine.model.outcome import Found
from cellwright.engine.pipelines.planning import checked_plan
from cellwright.engine.pipelines.planning.macros.cell_tasks import CellTasks
from cellwright.engine.stages.grounding import ground
from cellwright.engine.stages.grounding.grounding_program import ChangingPredicates
from cellwright.engine.stages.grounding.initial_facts import initial_state
from cellwright.engine.stages.lifted.cell_domain import CellDomain, Situation
from cellwright.engine.stages.planning import plan_task
from cellwright.kb.model.planning_problem import Problem
from tests.road_maps import road_map, road_problem


def situation(problem: Problem) -> Situation:
    state, _ = initial_state(problem, ChangingPredicates(problem.domain))
    return Situation.of(CellDomain(problem), state)


def reachable_states(task: GroundTask, known: set[str]) -> set[frozenset[str]]:
    """The states that can be reached, as far as atoms are known to another task, too."""
    seen, waiting = {task.initial}, [task.initial]
    while waiting:
        state = waiting.pop()
        for operator in task.operators:
            if not operator.preconditions & ~state:
                after = task.after(state, operator)
                if after not in seen:
                    seen.add(after)
                    waiting.append(after)
    return {frozenset(map(str, task.names(state))) & known for state in seen}


@given(seed=st.integers(0, 10_000))
@settings(max_examples=15, deadline=None, suppress_health_check=list(HealthCheck))
def test_a_task_of_the_cell_leads_where_a_task_of_the_problem_leads(
    tmp_path: Path, seed: int
) -> None:
    draw = Random(seed)
    roads, closed = road_map(draw, 4), draw.randrange(-1, 4)
    starts, goals = (
        [draw.sample(range(4), 2) for _ in range(2)],
        [draw.randrange(4) for _ in range(2)],
    )
    first, second = (
        road_problem(tmp_path, roads, start[0], f"at(v0, p{goal})", closed, (start[1],))
        for start, goal in zip(starts, goals, strict=True)
    )
    cells = CellTasks()
    cells.keep(first, ground(first))
    task = cells.task_of(second, situation(second))
    own = ground(second)
    if task is None:
        return
    known = {str(atom) for atom in own.atoms} & {str(atom) for atom in task.atoms}
    assert reachable_states(task, known) == reachable_states(own, known)
    one, other = plan_task(task), plan_task(own)
    assert isinstance(one, Found) == isinstance(other, Found)
    if isinstance(one, Found) and isinstance(other, Found):
        assert one.plan.cost == other.plan.cost


def test_a_vehicle_that_nothing_moves_is_no_reason_to_ground_again(tmp_path: Path) -> None:
    roads = {(0, 1): 1, (1, 0): 1, (1, 2): 1, (2, 1): 1, (3, 4): 1}
    cells = CellTasks()
    first = road_problem(tmp_path, roads, 0, "at(v0, p2)")
    cells.keep(first, ground(first))
    again = road_problem(tmp_path, roads, 2, "at(v0, p0)")
    assert cells.task_of(again, situation(again)) is not None
    elsewhere = road_problem(tmp_path, roads, 3, "at(v0, p4)")
    assert cells.task_of(elsewhere, situation(elsewhere)) is None  # it moves there


def test_another_cell_has_another_task(tmp_path: Path) -> None:
    roads = {(0, 1): 1, (1, 0): 1}
    cells = CellTasks()
    first = road_problem(tmp_path, roads, 0, "at(v0, p1)")
    cells.keep(first, ground(first))
    dearer = road_problem(tmp_path, {**roads, (0, 1): 2}, 0, "at(v0, p1)")
    assert cells.task_of(dearer, situation(dearer)) is None
    assert cells.leaves_nothing_out(dearer)
    outcome, _ = checked_plan.plan_and_ground(dearer, whole=True)
    assert isinstance(outcome, Found)
    assert outcome.plan.cost == 2
