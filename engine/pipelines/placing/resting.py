"""The graph in which regrasps are looked for, to be shown: where a part may lie, and how many holds lead from there to there."""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from cellwright.engine.model.geometry import Truths
from cellwright.engine.pipelines.placing.answers import Placed
from cellwright.engine.pipelines.placing.task import Task
from cellwright.engine.pipelines.placing.ways import possible, rests, serving

START, GOAL = "start", "goal"


@dataclass(frozen=True, slots=True)
class Resting:
    """`holds` counts the holds that serve at the start, at the goal, and where the part lies on a facet at its best turn there.

    `ways` counts the holds that serve at both of two, and `taken` are the places of the plan from the start to the goal.
    Whether the arm reaches is asked at the start and at the goal only.
    """

    holds: Mapping[str, int]
    ways: Mapping[tuple[str, str], int]
    taken: tuple[str, ...]


def resting(task: Task, found: Placed) -> Resting:
    """The graph of a task, and the way that its plan takes through it."""
    lying = list(rests(task))
    names = [START, *(each.facet for each, _ in lying), GOAL]
    table = serving(task, [T for _, T in lying])
    serves = np.column_stack([possible(task, task.T_start), table, possible(task, task.T_goal)])
    holds = {name: int(serves[:, _named(names, name)].sum(axis=0).max()) for name in names}
    common = serves.astype(np.int64).T @ serves.astype(np.int64)
    ways = {
        (one, other): int(common[np.ix_(_named(names, one), _named(names, other))].max())
        for one, other in combinations(dict.fromkeys(names), 2)
    }
    taken = (START, *(each.rest.removeprefix("on ") for each in found.carries))
    return Resting(holds, {pair: count for pair, count in ways.items() if count}, taken)


def _named(names: list[str], name: str) -> Truths:
    found: Truths = np.array([each == name for each in names])
    return found
