"""A slow checker of plans with times, written from the text of PDDL 2.1 (Fox & Long 2003), for
small tasks without numbers that change.

It makes sets of ground literals of every end of every step (definition 8), a sequence of happenings
(definition 11), and tests each pair of instants for interference (definition 12). It shares nothing
with the checker but the model.
"""

import itertools
from collections.abc import Iterator
from fractions import Fraction

from cellwright.kb.model.conditions import And, Comparison, Condition, Literal
from cellwright.kb.model.durative import (
    Moment,
    NumericChange,
    TemporalProblem,
    TimedPlan,
    TimedStep,
)
from cellwright.kb.terms import Number, Operation, Term, Variable, substitute_atom, substitute_term

Literals = frozenset[tuple[str, bool]]
Snap = tuple[
    Fraction,
    Literals,
    frozenset[str],
    frozenset[str],
    dict[str, Fraction],
    frozenset[str],
    list[Comparison],
]


def flat(condition: Condition) -> Iterator[Condition]:
    if isinstance(condition, And):
        for part in condition.parts:
            yield from flat(part)
    else:
        yield condition


def worth(term: Term, values: dict[str, Fraction]) -> Fraction:
    if isinstance(term, Number):
        return Fraction(term.value)
    if isinstance(term, Operation):
        one, two = worth(term.left, values), worth(term.right, values)
        return {
            "+": one + two,
            "-": one - two,
            "*": one * two,
            "/": one / two if two else Fraction(0),
        }[term.operator]
    return values[str(term)]


def names(term: Term) -> set[str]:
    if isinstance(term, Operation):
        return names(term.left) | names(term.right)
    return set() if isinstance(term, Number) else {str(term)}


def compared(test: Comparison, values: dict[str, Fraction]) -> bool:
    one, two = worth(test.left, values), worth(test.right, values)
    return {"=": one == two, "<": one < two, "<=": one <= two, ">": one > two, ">=": one >= two}[
        test.relation
    ]


class Slow:
    """Whether a plan is valid, in the plainest way."""

    def __init__(self, problem: TemporalProblem) -> None:
        self.problem = problem
        self.actions = {action.name: action for action in problem.actions}

    def parts(self, step: TimedStep, moment: Moment) -> tuple[Literals, list[Comparison]]:
        action = self.actions[step.action.name]
        own: dict[Variable, Term] = dict(
            zip([p.variable for p in action.parameters], step.action.arguments, strict=True)
        )
        literals, tests = set(), []
        for timed in action.conditions:
            if timed.moment is moment:
                for part in flat(timed.condition):
                    if isinstance(part, Literal):
                        literals.add((str(substitute_atom(part.atom, own)), part.positive))
                    else:
                        assert isinstance(part, Comparison)
                        left, right = (
                            substitute_term(part.left, own),
                            substitute_term(part.right, own),
                        )
                        tests.append(Comparison(left, part.relation, right, True))
        return frozenset(literals), tests

    def snap(self, step: TimedStep, moment: Moment) -> tuple:  # type: ignore[type-arg]
        action = self.actions[step.action.name]
        own: dict[Variable, Term] = dict(
            zip([p.variable for p in action.parameters], step.action.arguments, strict=True)
        )
        adds, deletes, changes = set(), set(), []
        for effect in action.effects:
            if effect.moment is moment:
                if isinstance(effect.change, NumericChange):
                    changes.append(
                        (
                            effect.change.kind,
                            str(substitute_term(effect.change.fluent, own)),
                            substitute_term(effect.change.amount, own),
                        )
                    )
                else:
                    (adds if effect.change.positive else deletes).add(
                        str(substitute_atom(effect.change.atom, own))
                    )
        literals, tests = self.parts(step, moment)
        time = step.start if moment is Moment.START else step.start + step.duration
        return time, literals, tests, adds, deletes, changes

    def accepts(self, plan: TimedPlan) -> bool:
        problem = self.problem
        if any(step.start < 0 for step in plan.steps):
            return False
        snaps = [
            self.snap(step, moment) for step in plan.steps for moment in (Moment.START, Moment.END)
        ]
        for time, group in itertools.groupby(
            sorted(problem.changes, key=lambda c: c.at), key=lambda c: c.at
        ):
            literals = [change.change for change in group if isinstance(change.change, Literal)]
            adds = {str(each.atom) for each in literals if each.positive}
            deletes = {str(each.atom) for each in literals if not each.positive}
            snaps.append((time, frozenset(), [], adds, deletes, []))
        if not all(self.apart(one, two) for one, two in itertools.combinations(snaps, 2)):
            return False
        return self.executes(plan, snaps)

    def apart(self, one: tuple, two: tuple) -> bool:  # type: ignore[type-arg]
        if abs(one[0] - two[0]) >= self.problem.epsilon:
            return True
        for a, b in ((one, two), (two, one)):
            needed = {name for name, _ in a[1]}
            if needed & (b[3] | b[4]) or a[3] & b[4]:
                return False
            read = {
                name for test in a[2] for side in (test.left, test.right) for name in names(side)
            }
            read |= {name for _, _, amount in a[5] for name in names(amount)}
            if read & {name for _, name, _ in b[5]}:
                return False
            for kind, name, _ in a[5]:
                if any(name == n and not {kind, k} <= {"increase", "decrease"} for k, n, _ in b[5]):
                    return False
        return True

    def executes(self, plan: TimedPlan, snaps: list) -> bool:  # type: ignore[type-arg]
        state = {str(atom) for atom in self.problem.initial}
        values = {str(name): value for name, value in self.problem.values.items()}
        for time in sorted({snap[0] for snap in snaps}):
            now = [snap for snap in snaps if snap[0] == time]
            starting = [step for step in plan.steps if step.start == time]
            if not all(self.length_fits(step, values) for step in starting):
                return False
            if not all(self.holds(snap[1], snap[2], state, values) for snap in now):
                return False
            happen(now, state, values)
            under_way = [s for s in plan.steps if s.start <= time < s.start + s.duration]
            during = [self.parts(step, Moment.THROUGHOUT) for step in under_way]
            if not all(self.holds(*part, state, values) for part in during):
                return False
        return all(
            (str(part.atom) in state) == part.positive
            for part in flat(self.problem.goal)
            if isinstance(part, Literal)
        )

    def holds(
        self,
        literals: Literals,
        tests: list[Comparison],
        state: set[str],
        values: dict[str, Fraction],
    ) -> bool:
        return all((name in state) == sign for name, sign in literals) and all(
            compared(t, values) for t in tests
        )

    def length_fits(self, step: TimedStep, values: dict[str, Fraction]) -> bool:
        action = self.actions[step.action.name]
        own: dict[Variable, Term] = dict(
            zip([p.variable for p in action.parameters], step.action.arguments, strict=True)
        )
        for limit in action.limits:
            amount = worth(substitute_term(limit.amount, own), values)
            off = step.duration - amount
            if {"=": abs(off), "<=": off, ">=": -off}[limit.relation] > Fraction(1, 10**6):
                return False
        return step.duration >= 0


def happen(now: list, state: set[str], values: dict[str, Fraction]) -> None:  # type: ignore[type-arg]
    """The effects of the instants of one time, all at once."""
    before = dict(values)
    for snap in now:
        state -= snap[4]
    for snap in now:
        state |= snap[3]
        for kind, name, amount in snap[5]:
            by = worth(amount, before)
            change = by if kind == "increase" else -by
            values[name] = by if kind == "assign" else values[name] + change
