"""Proofs that there is no plan: by what no state allows, and by the counters of workflow chains.

A step that lets many things happen at once moves many counters. Which of them it may move together
is asked of all states that definitions allow: four tubes of two weights are spun in pairs, and of
three tubes of one weight one is left over.
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

from cellwright.engine.kernels.bits import Bits, indices
from cellwright.engine.model.ground_axioms import OPPOSITE_SIGNS, Axioms, Comparing, QuantityLevel
from cellwright.engine.model.ground_task import ConditionalEffect, GroundOperator, GroundTask
from cellwright.engine.stages.planning.search_control import NO_PLAN, Effort, SearchResult
from cellwright.kb.asp.model_search import Questions, enumerate_models

COUNTER_PREFIX = "_stage"
MOST_SETS = 1_000  # sets of effects of one operator
MOST_OPERATORS = 200  # that have such sets
MAX_COUNTER_STATES = 30_000


class _Move(NamedTuple):
    needs: Bits
    adds: Bits
    deletes: Bits


def counters_stay_short(task: GroundTask, states: str) -> bool:
    """Whether no sequence of steps takes the counters to a goal; `states` is the program of all
    states, with atoms `a(number)`.
    """
    counted = sum(
        1 << number for number, atom in enumerate(task.atoms) if atom.name == COUNTER_PREFIX
    )
    together = [operator for operator in task.operators if _moved_bits(operator) & counted]
    if not counted or not together or len(together) > MOST_OPERATORS:
        return False
    moves: set[_Move] = set()
    for operator in task.operators:
        sets = _effect_sets(operator, states) if operator in together else iter([()])
        for number, effects in enumerate(sets):
            if number >= MOST_SETS:
                return False
            moves.add(_project_operator(operator, effects, counted))
    return _all_missed(task, counted, sorted(move for move in moves if move.adds))


def _moved_bits(operator: GroundOperator) -> Bits:
    moved = 0
    for effect in operator.conditional:
        moved |= effect.adds
    return moved


def _effect_sets(operator: GroundOperator, states: str) -> Iterator[tuple[ConditionalEffect, ...]]:
    """The sets of effects that may happen together, and no others with them."""
    lines = [f":- not a({atom})." for atom in indices(operator.preconditions)]
    for number, effect in enumerate(operator.conditional):
        lines.append(
            f"f({number}) :- {', '.join(f'a({atom})' for atom in indices(effect.condition))}."
        )
    text = "\n".join([states, *lines, "#defined f/1. #defined a/1."])
    for model in enumerate_models(text, "f", "none", MOST_SETS + 1):
        yield tuple(operator.conditional[number] for number in sorted(map(int, model.others)))


def _project_operator(
    operator: GroundOperator, effects: tuple[ConditionalEffect, ...], counted: Bits
) -> _Move:
    needs, adds, deletes, cancels = operator.preconditions, operator.adds, operator.deletes, 0
    for effect in effects:
        needs, adds, deletes = (
            needs | effect.condition,
            adds | effect.adds,
            deletes | effect.deletes,
        )
        cancels |= effect.cancels
    return _Move(needs & counted, adds & ~cancels & counted, deletes & counted)


def _all_missed(task: GroundTask, counted: Bits, moves: list[_Move]) -> bool:
    """Whether a search through the states of the counters ends without a goal."""
    first = task.initial & counted
    seen, waiting, goals = {first}, [first], [goal & counted for goal in task.goals]
    while waiting:
        state = waiting.pop()
        if any(goal & ~state == 0 for goal in goals) or len(seen) > MAX_COUNTER_STATES:
            return False
        new = {
            state & ~move.deletes | move.adds for move in moves if move.needs & ~state == 0
        } - seen
        seen |= new
        waiting += sorted(new)
    return True


# values of a quantity; what compares one with more values may be true and false
MAX_QUANTITY_VALUES = 2_000
MAX_SOLVER_NUMBER = 1 << 30  # numbers of the solver have 32 bits
MAX_QUESTIONS = 3_000  # questions
MAX_ENCODED_ATOMS = 100_000  # atoms in rules and mutex groups, and values in comparisons


class UnsolvabilityProof:
    """A strategy that answers at its first turn that there is no plan, or never."""

    def __init__(self, task: GroundTask) -> None:
        self.task, self.asked = task, False

    def run(self, effort: Effort) -> SearchResult | None:
        """`NO_PLAN` if the goals are out of reach without what no state allows."""
        if self.asked or self.task.axioms is None:
            return None
        self.asked = True
        possible = _possible_task(self.task, self.task.axioms, effort)
        if possible is None:
            return None
        if not possible.goals or _out_of_reach(possible):
            return NO_PLAN
        states = "\n".join(_states_program(possible, self.task.axioms))
        return NO_PLAN if counters_stay_short(possible, states) else None


def _out_of_reach(task: GroundTask) -> bool:
    from cellwright.engine.stages.planning.forward.forward_search import (
        start_forward_search,  # it loads compiled kernels
    )

    return start_forward_search(task, 0).run(Effort(2)) is NO_PLAN


def _possible_task(task: GroundTask, axioms: Axioms, effort: Effort) -> GroundTask | None:
    """The task without operators, effects and goals that no state allows; None if there is
    nothing to ask, or too much.
    """
    questions = sum(_count_questions(operator, axioms) for operator in task.operators)
    size = sum(rule.body.bit_count() for rule in axioms.rules) + sum(
        map(int.bit_count, task.mutex_groups)
    )
    size += sum(_value_count(test, task) or 0 for test in axioms.tests)
    if not 0 < questions <= MAX_QUESTIONS or size > MAX_ENCODED_ATOMS:
        return None
    states = _States(task, axioms)
    operators = []
    for operator in task.operators:
        if effort.interrupted():
            return None
        operators += (
            [operator]
            if not _count_questions(operator, axioms)
            else _allowed_operators(states, operator)
        )
    return replace(task, operators=tuple(operators), goals=tuple(filter(states.allow, task.goals)))


def _count_questions(operator: GroundOperator, axioms: Axioms) -> int:
    """How many questions an operator asks: one for what it needs, and one for what each effect
    needs.
    """
    derived = axioms.derived
    effects = sum(
        1
        for effect in operator.conditional
        if (effect.condition | operator.preconditions) & derived
    )
    return effects + (1 if operator.preconditions & derived else 0)


def _allowed_operators(states: "_States", operator: GroundOperator) -> list[GroundOperator]:
    if not states.allow(operator.preconditions):
        return []
    effects = tuple(
        e for e in operator.conditional if states.allow(operator.preconditions | e.condition)
    )
    return [replace(operator, conditional=effects)]


class _States:
    """The states that mutex groups, definitions and ranges allow."""

    def __init__(self, task: GroundTask, axioms: Axioms) -> None:
        self.known = (1 << axioms.size) - 1
        self.questions = Questions("\n".join(_states_program(task, axioms)))

    def allow(self, atoms: Bits) -> bool:
        """Whether some state has all of these atoms. Values of quantities are not looked at."""
        return self.questions.allow(indices(atoms & self.known))


def _states_program(task: GroundTask, axioms: Axioms) -> Iterator[str]:
    all_atoms = (1 << axioms.size) - 1
    yield from (f"{{ a({atom}) }}." for atom in indices(all_atoms & ~axioms.derived))
    for group in task.mutex_groups:
        yield f":- 2 {{ {'; '.join(f'a({atom})' for atom in indices(group & all_atoms))} }}."
    for rule in axioms.rules:
        yield f"a({rule.head}) :- {', '.join(f'a({atom})' for atom in indices(rule.body))}."
    for atom, complement in axioms.complements.items():
        yield f"a({complement}) :- not a({atom})."
        yield f":- a({complement}), a({atom})."
    bounded = [test for test in axioms.tests if _value_count(test, task) is not None]
    for level in dict.fromkeys(level for test in bounded for level, _ in test.sum.parts):
        values = "; ".join(
            f"v({level.number}, {low}..{high})" for low, high in _value_intervals(level, task)
        )
        yield f"1 {{ {values} }} 1."
    for test in axioms.tests:
        yield _comparison_text(test) if test in bounded else f"{{ a({test.atom}) }}."


def _comparison_text(test: Comparing) -> str:
    """A comparison, for every value that its quantities can have."""
    parts = "; ".join(
        f"{factor}*V,{level.number} : v({level.number}, V)" for level, factor in test.sum.parts
    )
    return (
        f"a({test.atom}) :- not #sum {{ {parts} }} {OPPOSITE_SIGNS[test.relation]} "
        f"{-test.sum.constant}."
    )


def _value_count(test: Comparing, task: GroundTask) -> int | None:
    """How many values its quantities have; None if they are too many, or too large for the
    solver.
    """
    widths, most = list[int](), abs(test.sum.constant)
    for level, factor in test.sum.parts:
        ends = [end for end in _value_intervals(level, task) if end[0] <= end[1]]
        widths.append(sum(high - low + 1 for low, high in ends))
        most += max((abs(factor * bound) for end in ends for bound in end), default=0)
    return (
        sum(widths)
        if most < MAX_SOLVER_NUMBER and all(width <= MAX_QUANTITY_VALUES for width in widths)
        else None
    )


def _value_intervals(level: QuantityLevel, task: GroundTask) -> list[tuple[int, int]]:
    """Intervals with every value that a quantity can have: the one at the start, what steps
    assign, and what they add up to.
    """
    intervals, up, down = [(level.of(task.initial),) * 2], False, False
    for change in (e for operator in task.operators for e in operator.changes if e.level is level):
        if dict(change.to.parts).get(level) == 1:
            low, high = change.to.without(level).range()
            up, down = up or high > 0, down or low < 0
        else:
            intervals.append(change.to.range())
    least, most = min(low for low, _ in intervals), max(high for _, high in intervals)
    ends = level.low if down else least, level.high if up else most
    inside = intervals if not (up or down) else [ends]
    return sorted({(max(low, level.low), min(high, level.high)) for low, high in inside})
