"""Why no step reaches a goal: missing operators, needs that exclude each other, ranges exceeded."""

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace

from cellwright.engine.model.ground_axioms import UNBOUNDED_VALUE, never_holds
from cellwright.engine.pipelines.explanation.causes import (
    PossibleCause,
    find_causes,
    ground_companions,
    plain_conjuncts,
)
from cellwright.engine.pipelines.explanation.possible_facts import ProblemSpace
from cellwright.engine.pipelines.explanation.unreachable_goals import GoalOrStage, with_goals_only
from cellwright.engine.stages.grounding.numeric_quantities import (
    COMPARISON_PREFIX,
    SeparatedQuantities,
    without_quantities,
)
from cellwright.engine.stages.validation.operator_semantics import Semantics
from cellwright.kb.model.conditions import And, BodyPart, Comparison, Condition, Literal, goal_parts
from cellwright.kb.model.domain_model import Domain, Operator, Quantity
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import (
    ANYTHING,
    Atom,
    Function,
    Number,
    Operation,
    Substitution,
    Term,
    Variable,
    match_term,
    stage_parts,
    substitute_atom,
    substitute_term,
    term_variables,
)

# steps that would reach a goal; of more of them, nobody wants to read each reason
MAX_EXPLAINED_STEPS = 3
MOST_NEEDS = 24

Infeasible = Callable[[Problem], bool]


def conflicting_needs(
    problem: Problem, goal: GoalOrStage, space: ProblemSpace, infeasible: Infeasible
) -> Iterator[str]:
    """For each step that would reach the goal: what it needs and never has at once, in words.

    Nothing if one need is out of reach.
    """
    atoms, before = _last_achievement(problem, goal)
    semantics = Semantics(problem)
    for atom in atoms:
        reaching = list(itertools.islice(find_causes(semantics, atom), MAX_EXPLAINED_STEPS + 1))
        if len(reaching) <= MAX_EXPLAINED_STEPS:
            for cause in reaching:
                if not any(map(space.misses, cause.atoms)):
                    yield from _conflict_sentences(
                        _NeedsOfStep.of(semantics, cause), before, infeasible
                    )


def _last_achievement(problem: Problem, goal: GoalOrStage) -> tuple[tuple[Atom, ...], Problem]:
    """What is to be made true at the end of a goal, and the problem that asks for all that
    comes before it.
    """
    if goal.chain:
        chain = next(chain for chain in problem.chains if chain.name == goal.chain)
        before = [replace(goal, stages=goal.stages - 1)] if goal.stages > 1 else []
        return stage_parts(chain.stages[goal.stages - 1]), with_goals_only(problem, before)
    atom = goal.condition
    return ((atom.atom,) if isinstance(atom, Literal) and atom.positive else ()), with_goals_only(
        problem, []
    )


@dataclass(frozen=True, slots=True)
class _NeedsOfStep:
    """What a step needs. `because` has the event that must not occur for each need that nothing
    but that asks for.
    """

    cause: PossibleCause
    parts: tuple[BodyPart, ...]
    because: tuple[tuple[BodyPart, Atom], ...]

    @classmethod
    def of(cls, semantics: Semantics, cause: PossibleCause) -> "_NeedsOfStep":
        """The needs of a step: its preconditions, and that it lets nothing happen that no
        workflow asks for.
        """
        asked = {stage for chain in semantics.problem.chains for stage in chain.stages}
        kept_needs = {
            replace(companion.when[0], positive=not companion.when[0].positive): companion.event
            for companion in ground_companions(semantics, cause)
            if companion.event not in asked
            and len(companion.when) == 1
            and isinstance(companion.when[0], Literal)
        }
        parts: dict[BodyPart, None] = dict.fromkeys((*cause.needs, *kept_needs))
        return cls(
            cause,
            tuple(parts),
            tuple((need, kept_needs[need]) for need in kept_needs if need not in cause.needs),
        )


def _conflict_sentences(
    needs: _NeedsOfStep, before: Problem, infeasible: Infeasible
) -> Iterator[str]:
    kept_parts = list(needs.parts)
    if len(kept_parts) > MOST_NEEDS or not infeasible(_asking_problem(before, kept_parts)):
        return
    for part in needs.parts:
        rest = [kept_part for kept_part in kept_parts if kept_part != part]
        if rest and infeasible(_asking_problem(before, rest)):
            kept_parts = rest
    if len(kept_parts) > 1:
        reasons = [
            f"no workflow asks for {event}" for need, event in needs.because if need in kept_parts
        ]
        *other_needs, last = map(str, kept_parts)
        sentence = (
            f"{needs.cause.name} needs {', '.join(other_needs)} and {last}, which never hold "
            "together"
        )
        yield f"{sentence}: {' and '.join(reasons)}" if reasons else sentence


def _asking_problem(problem: Problem, parts: Sequence[BodyPart]) -> Problem:
    return replace(problem, goal=And(tuple(parts)))


MOST_INSTANCES, MOST_ATOMS = 200, 300


def missing_operators(problem: Problem, space: ProblemSpace) -> Iterator[str]:
    """A sentence for each fact that a way to the goals needs, that does not hold and that no
    operator makes true.
    """
    seeking = _BackwardSearch(Semantics(problem), space)
    asked = (
        literal.atom
        for literal in plain_conjuncts(problem.goal)
        if isinstance(literal, Literal) and literal.positive
    )
    stages = (stage for chain in problem.chains if chain.wanted for stage in chain.stages)
    wanted = (part for stage in stages for part in stage_parts(stage))
    for atom in (*asked, *wanted):
        yield from seeking.back_from(atom, "the goal")


@dataclass
class _BackwardSearch:
    semantics: Semantics
    space: ProblemSpace
    seen: set[Atom] = field(default_factory=set)

    def back_from(self, atom: Atom, user: str) -> Iterator[str]:
        """The gaps behind an atom that `user` needs; nothing if it is within reach."""
        if atom in self.seen or len(self.seen) > MOST_ATOMS or not self.space.misses(atom):
            return
        self.seen.add(atom)
        possible_causes = list(itertools.islice(find_causes(self.semantics, atom), MOST_INSTANCES))
        if not possible_causes:
            yield f"no operator makes {atom} true, and {user} needs it"
        for cause in possible_causes:
            for needed in cause.atoms:
                yield from self.back_from(needed, cause.name)


def out_of_range(problem: Problem, goal: GoalOrStage) -> tuple[str, ...]:
    """Why ranges rule out a goal: itself, or a sentence for each step that would reach it; none
    if they allow some step.
    """
    asked = with_goals_only(problem, [goal])
    reading = _RangeReading(without_quantities(asked), problem.domain)
    stages = [
        part for chain in asked.chains if chain.wanted for part in stage_parts(chain.stages[-1])
    ]
    goal_atoms = [literal.atom for literal in _positive_literals(reading.taken.problem.goal)]
    for atom in (*stages, *goal_atoms):
        if reasons := tuple(reading.barred(atom)):
            return reasons
    return ()


def _positive_literals(condition: Condition) -> Iterator[Literal]:
    return (
        conjunct
        for conjunct in goal_parts(condition)
        if isinstance(conjunct, Literal) and conjunct.positive
    )


@dataclass(frozen=True, slots=True)
class _RangeReading:
    taken: SeparatedQuantities
    domain: Domain

    def barred(self, atom: Atom) -> Iterator[str]:
        """A sentence for each operator that would make an atom true; none if ranges allow one,
        or facts imply the atom.
        """
        if atom.name.startswith(COMPARISON_PREFIX):
            yield from (f"{needed} cannot be: {within}" for needed, within in self._missed(atom))
            return
        rules = self.domain.deductive_operators
        derivations = [
            None
            for rule in rules
            for consequence in rule.consequences
            if consequence.atom.name == atom.name
        ]
        reasons = [*derivations, *(self._reason(*making) for making in self._makers(atom))]
        if None not in reasons:
            yield from dict.fromkeys(reason for reason in reasons if reason)

    def _makers(self, atom: Atom) -> Iterator[tuple[Operator, Substitution]]:
        for operator in self.taken.problem.domain.operators:
            for effect in (e for e in operator.effects if e.adds and e.atom.name == atom.name):
                if (bound := match_term(effect.atom, atom, {})) is not None:
                    yield operator, bound

    def _reason(self, operator: Operator, bound: Substitution) -> str | None:
        """What an instance of an operator needs that no value of a quantity gives; None if
        there is no such thing.
        """
        header = substitute_atom(
            substitute_atom(operator.header, bound), _any_arguments(operator.header)
        )
        needs = (
            substitute_atom(literal.atom, bound)
            for literal in _positive_literals(operator.precondition)
        )
        missed = (
            miss
            for atom in needs
            if atom.name.startswith(COMPARISON_PREFIX)
            for miss in self._missed(atom)
        )
        return next((f"{header} needs {needed}, and {within}" for needed, within in missed), None)

    def _missed(self, atom: Atom) -> Iterator[tuple[Comparison, str]]:
        """A comparison that never holds, with the ranges that rule it out."""
        test = next(test for test in self.taken.tests if test.head.name == atom.name)
        inner = match_term(test.head, atom, {}) or {}
        left_term, right = (
            substitute_term(side, inner) for side in (test.comparison.left, test.comparison.right)
        )
        ranges = {v: self.domain.quantities[quantity.name] for v, quantity in test.values.items()}
        if never_holds(
            test.comparison.relation, *_value_interval(Operation("-", left_term, right), ranges)
        ):
            named = {v: substitute_atom(quantity, inner) for v, quantity in test.values.items()}
            needed = Comparison(
                substitute_term(left_term, named),
                test.comparison.relation,
                substitute_term(right, named),
            )
            yield (
                needed,
                ", ".join(
                    f"{named[v]} is within {_range_text(bounds)}" for v, bounds in ranges.items()
                ),
            )


def _any_arguments(header: Function) -> Substitution:
    return {variable: ANYTHING for variable in term_variables(header)}


def _range_text(bounds: Quantity) -> str:
    return "..".join("" if end is None else str(end) for end in (bounds.low, bounds.high))


def _value_interval(term: Term, ranges: dict[Variable, Quantity]) -> tuple[int, int]:
    """The least and the greatest value of a sum of quantities; anything else may have every
    value.
    """
    match term:
        case Number(value):
            return value, value
        case Variable() if term in ranges:
            bounds = ranges[term]
            low = -UNBOUNDED_VALUE if bounds.low is None else bounds.low
            return low, UNBOUNDED_VALUE if bounds.high is None else bounds.high
        case Operation("+" | "-" | "*" as sign, left_term, right):
            (a, b), (c, d) = _value_interval(left_term, ranges), _value_interval(right, ranges)
            if sign == "*":
                products = [a * c, a * d, b * c, b * d]
                return min(products), max(products)
            return (a + c, b + d) if sign == "+" else (a - d, b - c)
        case _:
            return -UNBOUNDED_VALUE, UNBOUNDED_VALUE
