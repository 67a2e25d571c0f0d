"""Interference: checks whether unordered steps of a plan can disturb each other.

If they can, the result of a plan may depend on their order.
"""

import itertools
from collections.abc import Hashable, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

from cellwright.engine.stages.validation.checker_facts import CheckerFacts
from cellwright.engine.stages.validation.condition_solving import Bindings, condition_holds
from cellwright.engine.stages.validation.operator_semantics import Semantics
from cellwright.engine.stages.validation.step_changes import CheckedChange, Denial, State
from cellwright.engine.stages.validation.step_precedence import (
    Region,
    StepPrecedence,
    TouchedKeys,
    disturbing_pairs,
    unordered_places,
)
from cellwright.kb.model.condition_forms import bind_variables
from cellwright.kb.model.conditions import ALWAYS_TRUE, Condition, literals_in
from cellwright.kb.model.domain_model import Operator
from cellwright.kb.model.plan_model import CausalLink, Plan, Step, StepId
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import (
    ANYTHING,
    Atom,
    Function,
    is_ground,
    match_term,
    substitute_atom,
    term_variables,
)

Key = tuple[Hashable, ...]
MAX_UNCERTAIN = 7  # if at most this many atoms are open, every combination is tried


@dataclass(frozen=True)
class ExecutedStep:
    """A step and what it did in the canonical order."""

    step: Step
    operator: Operator
    bindings: Bindings
    change: CheckedChange

    @cached_property
    def denied(self) -> State:
        """The single ground atoms that the step denies."""
        return frozenset(
            denial.pattern for denial in self.change.denials if denial.consequence is None
        )

    @cached_property
    def deductions(self) -> tuple[Denial, ...]:
        """The denials that come from deductive operators.

        Each denies every atom that matches it.
        """
        return tuple(denial for denial in self.change.denials if denial.consequence is not None)

    @cached_property
    def changed(self) -> Mapping[Key, list[Atom]]:
        """The atoms that change, by their names, and by their names and first arguments."""
        atoms_by_key: dict[Key, list[Atom]] = {}
        for atom in (*self.change.adds, *self.change.ends):
            atoms_by_key.setdefault(("changed", atom.name, None), []).append(atom)
            if atom.arguments:
                atoms_by_key.setdefault(("changed", atom.name, atom.arguments[0]), []).append(atom)
        return atoms_by_key

    def changes(self, pattern: Atom) -> bool:
        """Whether the step changes an atom that matches a pattern."""
        return any(
            match_term(pattern, atom, {}) is not None
            for atom in self.changed.get(_changed_key(pattern), ())
        )

    def denies(self, atom: Atom, statics: CheckerFacts) -> bool:
        """Whether the step denies an atom. The atom need not be true at the moment."""
        return atom in self.denied or any(
            deduction.matches(atom, statics) for deduction in self.deductions
        )


@dataclass
class StepReads:
    """What must not change while a step runs.

    Atoms in `true` must not become false, and atoms in `false` must not become true. Atoms that
    match a pattern in `watched` must not change at all.
    """

    true: set[Atom] = field(default_factory=set)
    false: set[Atom] = field(default_factory=set)
    watched: set[Atom] = field(default_factory=set)


class MentionedAtoms(NamedTuple):
    """The fluent atoms, or patterns of them, that the conditions of a step mention."""

    by_effects: set[Atom]
    by_precondition: set[Atom]
    regions: frozenset[Region]


@dataclass
class StepInterference:
    """The executed steps of a plan in their canonical order, and which of them come before
    which.
    """

    problem: Problem
    plan: Plan
    semantics: Semantics
    executed: Mapping[StepId, ExecutedStep]
    order: StepPrecedence
    start: State
    _of_steps: dict[Function, MentionedAtoms] = field(default_factory=dict)

    def conflicts(self) -> Iterator[str]:
        """A message for each pair of unordered steps that disturb each other.

        Such steps may come in either order or overlap.
        """
        steps = list(self.executed.values())
        reads: dict[StepId, StepReads] = {}
        deduced = any(step.deductions for step in steps)

        def touched(place: int) -> TouchedKeys:
            executed = steps[place]
            reads[executed.step.id] = self._reads(executed)
            return TouchedKeys(
                *map(
                    frozenset,
                    (
                        _changed_keys(executed),
                        _exposed_keys(executed, reads[executed.step.id], deduced),
                    ),
                )
            )

        places = unordered_places(self.order, lambda place: self._regions(steps[place]))
        for later, earlier in (
            map(steps.__getitem__, pair) for pair in disturbing_pairs(self.order, places, touched)
        ):
            problem = self._conflict(later, earlier, reads) or self._conflict(earlier, later, reads)
            if problem:
                yield f"steps {earlier.step.id} and {later.step.id} are unordered, but {problem}"

    def _regions(self, executed: ExecutedStep) -> set[Region]:
        """The regions that a step may touch: what it holds and changes, and all that it may depend
        on.

        Atoms end only where the step denies them.
        """
        regions = set(self._mentioned(executed).regions)
        regions.update([_pattern_region(atom) for atom in executed.change.adds])
        for denial in executed.change.denials:
            regions.add(
                _pattern_region(denial.pattern)
                if denial.consequence is None
                else (denial.pattern.name, ANYTHING)
            )
        for link in self._links_to.get(executed.step.id, ()):
            if not counts_stages(link.condition):
                regions.add(_pattern_region(split_negation(link.condition)[0]))
        regions.update([("", resource) for resource in executed.step.resources])
        return regions

    def _conflict(
        self, first: ExecutedStep, second: ExecutedStep, reads: dict[StepId, StepReads]
    ) -> str:
        """How `one` disturbs `other`; an empty text if it does not."""
        if first.step.resources and (
            shared := set(first.step.resources) & set(second.step.resources)
        ):
            return f"both hold {min(map(str, shared))}"
        needed = reads[second.step.id]
        if denied := self._denied(first, (needed.true, second.change.adds)):
            return (
                f"{first.step.operator} denies {min(map(str, denied))}, which "
                f"{second.step.operator} needs or adds"
            )
        added = needed.false & first.change.adds
        if added:
            return (
                f"{first.step.operator} adds {min(map(str, added))}, which "
                f"{second.step.operator} needs false"
            )
        if changed := [str(pattern) for pattern in needed.watched if first.changes(pattern)]:
            return (
                f"{first.step.operator} changes {min(changed)}, which {second.step.operator} "
                "depends on"
            )
        return ""

    def _denied(self, executed: ExecutedStep, exposed: Sequence[Set[Atom]]) -> set[Atom]:
        """The exposed atoms that a step denies and does not add."""
        if executed.deductions:
            atoms = set[Atom]().union(*exposed) - executed.change.adds
            return {atom for atom in atoms if executed.denies(atom, self.semantics.statics)}
        if all(map(executed.denied.isdisjoint, exposed)):
            return set()
        return {
            atom for atoms in exposed for atom in executed.denied & atoms
        } - executed.change.adds

    def _reads(self, executed: ExecutedStep) -> StepReads:
        """What a step depends on: its causal links if they prove the precondition, else all
        that it mentions.
        """
        reads = StepReads(watched=set(executed.change.triggered))
        for link in self._links_to.get(executed.step.id, ()):
            if not counts_stages(link.condition):
                atom, positive = split_negation(link.condition)
                (reads.true if positive else reads.false).add(atom)
        reads.watched -= reads.true
        operator, bindings = executed.operator, executed.bindings
        mentioned = self._mentioned(executed)
        reads.watched |= mentioned.by_effects
        if not self._proved(operator.precondition, bindings, reads):
            reads.watched |= mentioned.by_precondition
        return reads

    def _mentioned(self, executed: ExecutedStep) -> MentionedAtoms:
        """What the conditions of a step can depend on.

        All steps that are the same have the same.
        """
        mentioned = self._of_steps.get(executed.step.operator)
        if mentioned is None:
            operator, bindings = executed.operator, executed.bindings
            conditions = [
                e.condition for e in operator.effects if e.condition != ALWAYS_TRUE or e.parameters
            ]
            effects = {
                atom for condition in conditions for atom in self.mentioned(condition, bindings)
            }
            needed = set(self.mentioned(operator.precondition, bindings))
            mentioned = MentionedAtoms(
                effects, needed, frozenset(map(_pattern_region, effects | needed))
            )
            self._of_steps[executed.step.operator] = mentioned
        return mentioned

    def _proved(self, condition: Condition, bindings: Bindings, reads: StepReads) -> bool:
        """Whether the causal links make the condition true in every state that agrees with them.

        Bounds on what is true are tried first. If they are too coarse and few atoms are open, every
        such state is tried.
        """
        if condition == ALWAYS_TRUE:
            return True
        possible = self._possible.after(reads.false, frozenset()) if reads.false else self._possible
        lower, upper = self.semantics.bounds(reads.true, possible)
        if condition_holds(condition, lower, bindings, upper):
            return True
        behind = {
            name
            for literal in literals_in(condition)
            for name in self.semantics.fluents_behind(literal.atom.name)
        }
        open_ = self.everything - reads.false - reads.true
        uncertain = sorted((atom for atom in open_ if atom.name in behind), key=str)
        if len(uncertain) > MAX_UNCERTAIN:
            return False
        states = itertools.chain.from_iterable(
            itertools.combinations(uncertain, size) for size in range(len(uncertain) + 1)
        )
        return all(
            condition_holds(condition, self.semantics.facts((*reads.true, *more)), bindings)
            for more in states
        )

    @cached_property
    def _links_to(self) -> Mapping[StepId, list[CausalLink]]:
        links: dict[StepId, list[CausalLink]] = {}
        for link in self.plan.links:
            links.setdefault(link.consumer, []).append(link)
        return links

    @cached_property
    def everything(self) -> State:
        """Every atom that is true at some time."""
        return self.start.union(*(executed.change.adds for executed in self.executed.values()))

    @cached_property
    def _possible(self) -> CheckerFacts:
        """The same, as facts."""
        return CheckerFacts(self.everything)

    def mentioned(self, condition: Condition, bindings: Bindings) -> Iterator[Atom]:
        """The fluent atoms, or patterns of them, on which a condition can depend."""
        for literal in literals_in(bind_variables(condition, bindings)):
            atom = literal.atom
            fluents = self.semantics.fluents_behind(atom.name)
            if fluents == {atom.name}:
                yield substitute_atom(atom, dict.fromkeys(term_variables(atom), ANYTHING))
            else:
                yield from (atom_pattern(self.problem, name) for name in sorted(fluents))


def _changed_keys(executed: ExecutedStep) -> Iterator[Key]:
    """What a step changes: resources that it holds, atoms that it denies or adds, and patterns
    of what it changes.
    """
    yield from (("held", resource) for resource in executed.step.resources)
    yield from (("true", atom) for atom in executed.denied)
    yield from (("of", deduction.pattern.name) for deduction in executed.deductions)
    yield from (("false", atom) for atom in executed.change.adds)
    yield from executed.changed


def _exposed_keys(executed: ExecutedStep, reads: StepReads, deduced: bool) -> Iterator[Key]:
    """Where others can disturb a step: each is among what they change, if they do.

    Whether any step denies by deduction is known.
    """
    yield from (("held", resource) for resource in executed.step.resources)
    for atom in (*reads.true, *executed.change.adds):
        yield "true", atom
        if deduced:
            yield "of", atom.name
    yield from (("false", atom) for atom in reads.false)
    yield from map(_changed_key, reads.watched)


def _pattern_region(pattern: Atom) -> Region:
    """The region of an atom, or of all atoms that match a pattern."""
    if not pattern.arguments:
        return (pattern.name, None)
    first = pattern.arguments[0]
    return (pattern.name, first if is_ground(first) else ANYTHING)


def _changed_key(pattern: Atom) -> Key:
    """The key of the changed atoms of which some may match a pattern."""
    first = pattern.arguments[0] if pattern.arguments and is_ground(pattern.arguments[0]) else None
    return "changed", pattern.name, first


def atom_pattern(problem: Problem, name: str) -> Atom:
    """A pattern that matches every atom of a predicate."""
    return Function(name, (ANYTHING,) * len(problem.domain.predicates[name].arguments))


def split_negation(condition: Atom) -> tuple[Atom, bool]:
    """The atom of a condition, and whether it must be true: `not(p)` is the condition that p is
    false.
    """
    if (
        condition.name == "not"
        and len(condition.arguments) == 1
        and isinstance(condition.arguments[0], Function)
    ):
        return condition.arguments[0], False
    return condition, True


def counts_stages(condition: Atom) -> bool:
    """Whether a condition counts the stages of a chain.

    The workflow check handles such conditions by itself.
    """
    return (
        split_negation(condition)[0].name == "_stage"
        if condition.name == "not"
        else condition.name == "_stage"
    )
