"""Steps that no state allows, with derived atoms and quantities as they are defined: a proof that there is no plan.

A state is taken to be any set of atoms that mutex groups and the ranges of quantities allow, with what follows from it. The
question whether one of them has all that a step needs is one of stable models. What is never possible is left out, and
if the goals are out of reach then though nothing is ever denied, there is no plan.
"""

from collections.abc import Iterator
from dataclasses import replace

from cellwright.engine.model.axioms import Axioms
from cellwright.engine.model.quantities import OPPOSITE, Comparing, Level
from cellwright.engine.model.task import Bits, GroundOperator, Task, indices
from cellwright.engine.stages.planning.counters import counters_stay_short
from cellwright.engine.stages.planning.effort import NO_PLAN, Effort, SearchResult
from cellwright.kb.asp.questions import Questions

WIDEST = 2_000  # values of a quantity; what compares one with more values may be true and false
HUGE = 1 << 30  # numbers of the solver have 32 bits
MOST = 3_000  # questions
LARGEST = 100_000  # atoms in rules and mutex groups, and values in comparisons


class Proof:
    """A strategy that answers at its first turn that there is no plan, or never."""

    def __init__(self, task: Task) -> None:
        self.task, self.asked = task, False

    def run(self, effort: Effort) -> SearchResult | None:
        """`NO_PLAN` if the goals are out of reach without what no state allows."""
        if self.asked or self.task.axioms is None:
            return None
        self.asked = True
        possible = _possible(self.task, self.task.axioms, effort)
        if possible is None:
            return None
        if not possible.goals or _out_of_reach(possible):
            return NO_PLAN
        states = "\n".join(_program(possible, self.task.axioms))
        return NO_PLAN if counters_stay_short(possible, states) else None


def _out_of_reach(task: Task) -> bool:
    from cellwright.engine.stages.planning.forward.search import forward  # it loads compiled kernels

    return forward(task, 0).run(Effort(2)) is NO_PLAN


def _possible(task: Task, axioms: Axioms, effort: Effort) -> Task | None:
    """The task without operators, effects and goals that no state allows; None if there is nothing to ask, or too much."""
    questions = sum(_asks(operator, axioms) for operator in task.operators)
    size = sum(rule.body.bit_count() for rule in axioms.rules) + sum(map(int.bit_count, task.mutex_groups))
    size += sum(_width(each, task) or 0 for each in axioms.tests)
    if not 0 < questions <= MOST or size > LARGEST:
        return None
    states = _States(task, axioms)
    operators = []
    for operator in task.operators:
        if effort.interrupted():
            return None
        operators += [operator] if not _asks(operator, axioms) else _allowed(states, operator)
    return replace(task, operators=tuple(operators), goals=tuple(filter(states.allow, task.goals)))


def _asks(operator: GroundOperator, axioms: Axioms) -> int:
    """How many questions an operator asks: one for what it needs, and one for what each effect needs."""
    derived = axioms.derived
    effects = sum(1 for each in operator.conditional if (each.condition | operator.preconditions) & derived)
    return effects + (1 if operator.preconditions & derived else 0)


def _allowed(states: "_States", operator: GroundOperator) -> list[GroundOperator]:
    if not states.allow(operator.preconditions):
        return []
    kept = tuple(e for e in operator.conditional if states.allow(operator.preconditions | e.condition))
    return [replace(operator, conditional=kept)]


class _States:
    """The states that mutex groups, definitions and ranges allow."""

    def __init__(self, task: Task, axioms: Axioms) -> None:
        self.known = (1 << axioms.size) - 1
        self.questions = Questions("\n".join(_program(task, axioms)))

    def allow(self, atoms: Bits) -> bool:
        """Whether some state has all of these atoms. Values of quantities are not looked at."""
        return self.questions.allow(indices(atoms & self.known))


def _program(task: Task, axioms: Axioms) -> Iterator[str]:
    known = (1 << axioms.size) - 1
    yield from (f"{{ a({atom}) }}." for atom in indices(known & ~axioms.derived))
    for group in task.mutex_groups:
        yield f":- 2 {{ {'; '.join(f'a({atom})' for atom in indices(group & known))} }}."
    for rule in axioms.rules:
        yield f"a({rule.head}) :- {', '.join(f'a({atom})' for atom in indices(rule.body))}."
    for atom, complement in axioms.complements.items():
        yield f"a({complement}) :- not a({atom})."
        yield f":- a({complement}), a({atom})."
    bounded = [each for each in axioms.tests if _width(each, task) is not None]
    for level in dict.fromkeys(level for test in bounded for level, _ in test.sum.parts):
        values = "; ".join(f"v({level.number}, {low}..{high})" for low, high in _values(level, task))
        yield f"1 {{ {values} }} 1."
    for test in axioms.tests:
        yield _compared(test) if test in bounded else f"{{ a({test.atom}) }}."


def _compared(test: Comparing) -> str:
    """A comparison, for every value that its quantities can have."""
    parts = "; ".join(f"{factor}*V,{level.number} : v({level.number}, V)" for level, factor in test.sum.parts)
    return f"a({test.atom}) :- not #sum {{ {parts} }} {OPPOSITE[test.relation]} {-test.sum.constant}."


def _width(test: Comparing, task: Task) -> int | None:
    """How many values its quantities have; None if they are too many, or too large for the solver."""
    widths, most = list[int](), abs(test.sum.constant)
    for level, factor in test.sum.parts:
        ends = [end for end in _values(level, task) if end[0] <= end[1]]
        widths.append(sum(high - low + 1 for low, high in ends))
        most += max((abs(factor * each) for end in ends for each in end), default=0)
    return sum(widths) if most < HUGE and all(width <= WIDEST for width in widths) else None


def _values(level: Level, task: Task) -> list[tuple[int, int]]:
    """Intervals with every value that a quantity can have: the one at the start, what steps assign, and what they add up to."""
    found, up, down = [(level.of(task.initial),) * 2], False, False
    for each in (e for operator in task.operators for e in operator.changes if e.level is level):
        if dict(each.to.parts).get(level) == 1:
            low, high = each.to.without(level).range()
            up, down = up or high > 0, down or low < 0
        else:
            found.append(each.to.range())
    least, most = min(low for low, _ in found), max(high for _, high in found)
    ends = level.low if down else least, level.high if up else most
    inside = found if not (up or down) else [ends]
    return sorted({(max(low, level.low), min(high, level.high)) for low, high in inside})
