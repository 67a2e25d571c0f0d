"""Recurring sub-sequences of plans, and the specialised MACROPs that are made of them.

Sub-sequences that recur in the plans of a domain may help a search (Botea, Enzenberger, Müller &
Schaeffer 2005, who join the steps of the causal graph of a solution). Whether they do is measured
elsewhere.
"""

from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

from cellwright.kb.model.conditions import Literal, Parameter, substitute_part
from cellwright.kb.model.plan_model import Macrop, MacroStep, Plan, Step, StepId
from cellwright.kb.terms import (
    Atom,
    Function,
    Substitution,
    Term,
    Variable,
    match_term,
    substitute_atom,
    substitute_term,
)

MAX_SUBSEQUENCE_STEPS = 4  # steps of the longest sub-sequence
MAX_SEARCHED_STEPS = 200  # steps; longer plans are not searched for sub-sequences
Positions = int
"""A set of steps of a plan by their positions, as a bitset."""


@dataclass(frozen=True, slots=True)
class RecurringSequence:
    """The sub-sequences of one shape: how many there are, and one of them with the steps before
    it.
    """

    count: int
    before: tuple[Step, ...]
    steps: tuple[Step, ...]

    @property
    def operators(self) -> tuple[Function, ...]:
        """The operators of the one sub-sequence."""
        return tuple(step.operator for step in self.steps)


def recurring_sequences(plan: Plan) -> list[RecurringSequence]:
    """The sub-sequences of a plan by shape. Those that would save the most steps come first."""
    kinds: dict[str, list[Positions]] = {}
    order = PlanOrder(plan)
    for subsequence in order.subsequences:
        kinds.setdefault(sequence_shape(order.operators(subsequence)), []).append(subsequence)
    ranked = sorted(
        kinds.items(), key=lambda kind: (-len(kind[1]) * (kind[1][0].bit_count() - 1), kind[0])
    )
    return [
        RecurringSequence(len(own), order.steps(order.before(own[0])), order.steps(own[0]))
        for _, own in ranked
    ]


def matching_sequences(
    order: "PlanOrder", pattern: Sequence[Function], but: Collection[StepId] = ()
) -> Iterator[tuple[Step, ...]]:
    """The sub-sequences of a plan that are instances of a pattern.

    They overlap neither each other nor the steps `but`.
    """
    taken = sum(1 << place for place, step in enumerate(order.plan.steps) if step.id in but)
    for positions in sorted(order.subsequences):
        free = positions.bit_count() == len(pattern) and not positions & taken
        if free and matches_pattern(pattern, order.operators(positions)):
            taken |= positions
            yield order.steps(positions)


def sequence_shape(operators: Iterable[Function]) -> str:
    """The shape of a sequence: its operators, and which of their arguments are equal.

    Names do not matter.
    """
    names: dict[Term, Term] = {}
    return ", ".join(str(_rename_constants(operator, names)) for operator in operators)


def _rename_constants(term: Term, names: dict[Term, Term]) -> Term:
    """A term whose constants, variables and numbers are replaced by variables, equal ones by
    the same.
    """
    if isinstance(term, Function) and term.arguments:
        return Function(
            term.name, tuple(_rename_constants(argument, names) for argument in term.arguments)
        )
    return names.setdefault(term, Variable(f"X{len(names)}"))


def matches_pattern(pattern: Sequence[Function], operators: Sequence[Function]) -> bool:
    """Whether the operators are an instance of the pattern, step by step."""
    bindings: dict[Variable, Term] | None = {}
    for step, operator in zip(pattern, operators, strict=True):
        bindings = None if bindings is None else match_term(step, operator, bindings)
    return bindings is not None


class PlanOrder:
    """The steps before and after each step of a plan, and the steps to which causal links join
    it.
    """

    def __init__(self, plan: Plan) -> None:
        self.plan = plan
        places = {step.id: place for place, step in enumerate(plan.steps)}
        self._earlier = [0] * len(plan.steps)
        self._later = [0] * len(plan.steps)
        self._joined = [0] * len(plan.steps)
        for step, earlier in plan.predecessors().items():
            for earlier_step in earlier:
                self._earlier[places[step]] |= 1 << places[earlier_step]
                self._later[places[earlier_step]] |= 1 << places[step]
        for link in plan.links:
            if link.producer in places and link.consumer in places:
                self._joined[places[link.producer]] |= 1 << places[link.consumer]
                self._joined[places[link.consumer]] |= 1 << places[link.producer]

    @cached_property
    def subsequences(self) -> list[Positions]:
        """All connected sets of at least two steps such that no other step must come between
        them.
        """
        sequences: dict[Positions, None] = {}
        grown = dict.fromkeys(1 << place for place in range(len(self.plan.steps)))
        for _ in range(MAX_SUBSEQUENCE_STEPS - 1):
            grown = dict.fromkeys(
                sequence | 1 << place
                for sequence in grown
                for place in _set_places(_union_positions(self._joined, sequence) & ~sequence)
            )
            sequences.update(grown)
        return [sequence for sequence in sequences if self._convex(sequence)]

    def _convex(self, positions: Positions) -> bool:
        between = _union_positions(self._earlier, positions) & _union_positions(
            self._later, positions
        )
        return not between & ~positions

    def before(self, positions: Positions) -> Positions:
        """The other steps that must come before at least one of these."""
        return _union_positions(self._earlier, positions) & ~positions

    def steps(self, positions: Positions) -> tuple[Step, ...]:
        """The steps at these positions, in the order of the plan."""
        return tuple(self.plan.steps[place] for place in _set_places(positions))

    def operators(self, positions: Positions) -> tuple[Function, ...]:
        """The operators of the steps at these positions."""
        return tuple(step.operator for step in self.steps(positions))


def _set_places(positions: Positions) -> Iterator[int]:
    while positions:
        low = positions & -positions
        yield low.bit_length() - 1
        positions ^= low


def _union_positions(sets: Sequence[Positions], positions: Positions) -> Positions:
    union = 0
    for place in _set_places(positions):
        union |= sets[place]
    return union


def specialise_macro(macrop: Macrop, operators: Sequence[Function]) -> Macrop:
    """A MACROP with one variable for each object in `operators`, the steps that it was generalised
    from.

    The MACROP must have no workflow chains.
    """
    bindings: dict[Variable, Term] | None = {}
    for step, operator in zip(macrop.steps, operators, strict=True):
        bindings = None if bindings is None else match_term(step.operator, operator, bindings)
    first: dict[Term, Variable] = {}
    for variable, term in (bindings or {}).items():
        first.setdefault(term, variable)
    return _substitute_macro(
        macrop, {variable: first[term] for variable, term in (bindings or {}).items()}
    )


def _substitute_macro(macrop: Macrop, same: Substitution) -> Macrop:
    arguments = dict.fromkeys(substitute_term(argument, same) for argument in macrop.name.arguments)
    types = dict.fromkeys(
        (substitute_term(type_test.variable, same), type_test.type) for type_test in macrop.types
    )
    return replace(
        macrop,
        name=Function(macrop.name.name, tuple(arguments)),
        goals=_substitute_literals(macrop.goals, same),
        preconditions=_substitute_literals(macrop.preconditions, same),
        adders=tuple(dict.fromkeys(_substitute_atoms(macrop.adders, same))),
        types=tuple(
            Parameter(variable, name) for variable, name in types if isinstance(variable, Variable)
        ),
        constraints=tuple(
            dict.fromkeys(substitute_part(constraint, same) for constraint in macrop.constraints)
        ),
        disequalities=tuple(
            dict.fromkeys(
                replace(
                    disequality,
                    left=substitute_term(disequality.left, same),
                    right=substitute_term(disequality.right, same),
                )
                for disequality in macrop.disequalities
            )
        ),
        exclusions=tuple(
            tuple(substitute_part(part, same) for part in body) for body in macrop.exclusions
        ),
        resources=tuple(
            dict.fromkeys(substitute_term(resource, same) for resource in macrop.resources)
        ),
        steps=tuple(_substitute_step(step, same) for step in macrop.steps),
        links=tuple(
            replace(link, condition=substitute_atom(link.condition, same)) for link in macrop.links
        ),
    )


def _substitute_literals(literals: Iterable[Literal], same: Substitution) -> tuple[Literal, ...]:
    return tuple(
        dict.fromkeys(
            Literal(substitute_atom(literal.atom, same), literal.positive) for literal in literals
        )
    )


def _substitute_atoms(atoms: Iterable[Atom], same: Substitution) -> Iterable[Atom]:
    return (substitute_atom(atom, same) for atom in atoms)


def _substitute_step(step: MacroStep, same: Substitution) -> MacroStep:
    return replace(
        step,
        operator=substitute_atom(step.operator, same),
        resources=tuple(substitute_term(resource, same) for resource in step.resources),
        duration=substitute_term(step.duration, same),
        cost=substitute_term(step.cost, same),
    )
