"""What is known of the value of each state: a table with open addressing, keyed by two words."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from engine.stages.diagnosis.kernels import compiled

Longs = NDArray[np.int64]
Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

EXPANSIONS, ENTRIES, STATUS, BUDGET = 0, 1, 2, 3  # of `counts`
RUNNING, SPENT, FULL = 0, 1, 2  # of `counts[STATUS]`


class Memo(NamedTuple):
    """For each state (`possible`, `rest`) a lower bound of its value, and whether it is the value itself.

    `possible` is 0 where a slot is empty: a state without causes has no value. The length is a power of two.
    """

    possible: Longs
    rest: Longs
    value: Floats
    exact: Flags
    counts: Longs


def memo(length: int, budget: int) -> Memo:
    """An empty table of `length` slots, a power of two."""
    counts = np.zeros(4, dtype=np.int64)
    counts[BUDGET] = budget
    return Memo(
        np.zeros(length, dtype=np.int64),
        np.zeros(length, dtype=np.int64),
        np.zeros(length),
        np.zeros(length, dtype=np.bool_),
        counts,
    )


@compiled
def slot(table: Memo, possible: int, rest: int) -> int:
    """Where the state stands, or the empty slot where it would."""
    last = table.possible.shape[0] - 1
    mixed = (possible * -7046029254386353131) ^ (rest * -4417276706812531889)
    mixed ^= mixed >> 31
    mixed *= -7723592293110705685
    at = (mixed ^ (mixed >> 29)) & last
    while table.possible[at] != 0 and (table.possible[at] != possible or table.rest[at] != rest):
        at = (at + 1) & last
    return int(at)


@compiled
def enter(table: Memo, at: int, possible: int, rest: int, value: float, exact: bool) -> None:
    """Fill an empty slot; the status says when the table has become too full to go on."""
    table.possible[at], table.rest[at] = possible, rest
    table.value[at], table.exact[at] = value, exact
    table.counts[ENTRIES] += 1
    if 4 * table.counts[ENTRIES] > 3 * table.possible.shape[0]:
        table.counts[STATUS] = FULL


@compiled
def conclude(table: Memo, possible: int, rest: int, floor: float, limit: float) -> float:
    """Note that a value is at least `floor`, and that it is the value if all below `limit` was searched; what is known."""
    at = slot(table, possible, rest)
    table.value[at] = max(table.value[at], floor)
    table.exact[at] = table.counts[STATUS] == RUNNING and floor < limit
    return float(table.value[at])


@compiled
def expand(table: Memo) -> None:
    """Count one expansion; the status says when the budget is spent."""
    table.counts[EXPANSIONS] += 1
    if table.counts[EXPANSIONS] >= table.counts[BUDGET] and table.counts[STATUS] == RUNNING:
        table.counts[STATUS] = SPENT


@compiled
def copy(source: Memo, target: Memo) -> None:
    """Enter everything of one table into a larger one."""
    for i in range(source.possible.shape[0]):
        if source.possible[i] != 0:
            at = slot(target, source.possible[i], source.rest[i])
            enter(target, at, source.possible[i], source.rest[i], source.value[i], source.exact[i])


def grown(table: Memo) -> Memo:
    """A table four times as long with the same content and counts."""
    larger = memo(4 * table.possible.shape[0], int(table.counts[BUDGET]))
    copy(table, larger)
    larger.counts[EXPANSIONS] = table.counts[EXPANSIONS]
    return larger


@compiled
def insert(action: int, value: float, order: Longs, values: Floats, count: int) -> int:
    """Put an action among the first `count`, which ascend by value, behind its equals; how many there are then."""
    place = count
    while place > 0 and values[place - 1] > value:
        values[place], order[place] = values[place - 1], order[place - 1]
        place -= 1
    values[place], order[place] = value, action
    return count + 1
