"""States evaluated by compiled kernels: relaxed plans over operators and, beside them, their conditional effects."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from engine.model.task import Bits, GroundOperator, indices
from engine.planning.kernels import Operators, Room, evaluate

Ints = NDArray[np.int32]


@dataclass(frozen=True, slots=True)
class Rows:
    """Lists of numbers, one after another: list i is items[starts[i]:starts[i + 1]]."""

    starts: Ints
    items: Ints


def rows(lists: Sequence[Sequence[int]]) -> Rows:
    """Lists as compressed rows."""
    starts = np.zeros(len(lists) + 1, np.int32)
    starts[1:] = np.cumsum([len(each) for each in lists], dtype=np.int64)
    return Rows(starts, np.fromiter(itertools.chain.from_iterable(lists), np.int32, int(starts[-1])))


def effects(operators: Sequence[GroundOperator]) -> tuple[list[GroundOperator], list[int]]:
    """Operators without deletes: the given ones, then one for each conditional effect; and the operator of each."""
    relaxed, owners = list(operators), list(range(len(operators)))
    for number, operator in enumerate(operators):
        for effect in operator.conditional:
            condition = operator.preconditions | effect.condition
            relaxed.append(replace(operator, preconditions=condition, adds=effect.adds, conditional=()))
            owners.append(number)
    return relaxed, owners


class Evaluation:
    """Relaxed plans from any state to one conjunction of goals, over atoms numbered below `size`."""

    def __init__(self, operators: Sequence[GroundOperator], goals: Bits, size: int) -> None:
        self.operators, self._owners = effects(operators)
        self._plain = len(operators)
        self._width = max((size + 63) // 64, 1)
        needs = [list(indices(operator.preconditions)) for operator in self.operators]
        users: list[list[int]] = [[] for _ in range(size)]
        for number, needed in enumerate(needs):
            for atom in needed:
                users[atom].append(number)
        self._goals = np.fromiter(indices(goals), np.int32)
        self._arrays, self._room = self._laid_out(rows(needs), rows(users), size)

    def _laid_out(self, need: Rows, user: Rows, size: int) -> tuple[Operators, Room]:
        """The operators as arrays, and room to work in."""
        count = len(self.operators)
        add = rows([list(indices(operator.adds)) for operator in self.operators])
        costs = np.fromiter((max(operator.cost, 1) for operator in self.operators), np.int32, count)
        lengths = (size, size, count, count, *[size + len(add.items) + 1] * 2)
        work = [np.zeros(length, np.int32) for length in lengths]
        most = len(need.items) + len(self._goals) + 1
        rest = [np.zeros(length, np.int32) for length in (count, most, count, count)]
        starts = (need.starts, need.items, add.starts, add.items, user.starts, user.items)
        return Operators(costs, np.diff(need.starts), *starts), Room(*work, *rest)

    def __call__(self, state: Bits) -> tuple[int, list[int], list[int]]:
        """The cost of a relaxed plan (-1 if there is none), the applicable operators, and those it begins with."""
        words = np.frombuffer(state.to_bytes(self._width * 8, "little"), np.uint64)
        room = self._room
        estimate, applicable, preferred = evaluate(words, self._goals, self._arrays, room)
        found, helpful = room.applicable[:applicable].tolist(), room.preferred[:preferred].tolist()
        if len(self.operators) > self._plain:
            found = [number for number in found if number < self._plain]
            helpful = list(dict.fromkeys(self._owners[number] for number in helpful))
        return estimate, found, helpful
