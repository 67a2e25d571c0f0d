"""What is left of a task if only the counters of its workflow chains are looked at: small enough to be searched to the end.

A step that lets many things happen at once moves many counters. Which of them it may move together is asked of all states that
definitions allow: four tubes of two weights are spun in pairs, and of three tubes of one weight one is left over.
"""

from collections.abc import Iterator
from typing import NamedTuple

from cellwright.engine.model.task import Bits, ConditionalEffect, GroundOperator, Task, indices
from cellwright.kb.asp.models import models

COUNTER = "_stage"
MOST_SETS = 1_000  # sets of effects of one operator
MOST_OPERATORS = 200  # that have such sets
MOST_STATES = 30_000


class _Move(NamedTuple):
    needs: Bits
    adds: Bits
    deletes: Bits


def counters_stay_short(task: Task, states: str) -> bool:
    """Whether no sequence of steps takes the counters to a goal; `states` is the program of all states, with atoms `a(number)`."""
    counted = sum(1 << number for number, atom in enumerate(task.atoms) if atom.name == COUNTER)
    together = [each for each in task.operators if _moved(each) & counted]
    if not counted or not together or len(together) > MOST_OPERATORS:
        return False
    moves: set[_Move] = set()
    for operator in task.operators:
        sets = _sets(operator, states) if operator in together else iter([()])
        for number, effects in enumerate(sets):
            if number >= MOST_SETS:
                return False
            moves.add(_projected(operator, effects, counted))
    return _all_missed(task, counted, sorted(each for each in moves if each.adds))


def _moved(operator: GroundOperator) -> Bits:
    found = 0
    for effect in operator.conditional:
        found |= effect.adds
    return found


def _sets(operator: GroundOperator, states: str) -> Iterator[tuple[ConditionalEffect, ...]]:
    """The sets of effects that may happen together, and no others with them."""
    lines = [f":- not a({atom})." for atom in indices(operator.preconditions)]
    for number, effect in enumerate(operator.conditional):
        lines.append(f"f({number}) :- {', '.join(f'a({atom})' for atom in indices(effect.condition))}.")
    text = "\n".join([states, *lines, "#defined f/1. #defined a/1."])
    for model in models(text, "f", "none", MOST_SETS + 1):
        yield tuple(operator.conditional[number] for number in sorted(map(int, model.others)))


def _projected(operator: GroundOperator, effects: tuple[ConditionalEffect, ...], counted: Bits) -> _Move:
    needs, adds, deletes, cancels = operator.preconditions, operator.adds, operator.deletes, 0
    for each in effects:
        needs, adds, deletes = needs | each.condition, adds | each.adds, deletes | each.deletes
        cancels |= each.cancels
    return _Move(needs & counted, adds & ~cancels & counted, deletes & counted)


def _all_missed(task: Task, counted: Bits, moves: list[_Move]) -> bool:
    """Whether a search through the states of the counters ends without a goal."""
    first = task.initial & counted
    seen, waiting, goals = {first}, [first], [goal & counted for goal in task.goals]
    while waiting:
        state = waiting.pop()
        if any(goal & ~state == 0 for goal in goals) or len(seen) > MOST_STATES:
            return False
        new = {state & ~each.deletes | each.adds for each in moves if each.needs & ~state == 0} - seen
        seen |= new
        waiting += sorted(new)
    return True
