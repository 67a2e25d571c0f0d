"""Checks whether unordered steps can disturb each other.

If they can, the result of a plan may depend on their order.
"""

import itertools
from collections.abc import Hashable, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

from cellwright.engine.stages.validation.changes import Denial, State, StepChange
from cellwright.engine.stages.validation.datalog import Bindings, holds
from cellwright.engine.stages.validation.facts import Facts
from cellwright.engine.stages.validation.pairs import Region, Touched, loose, pairs
from cellwright.engine.stages.validation.precedence import Precedence
from cellwright.engine.stages.validation.semantics import Semantics
from cellwright.kb.model.bindings import bind
from cellwright.kb.model.conditions import TRUE, Condition, literals
from cellwright.kb.model.domain import Operator
from cellwright.kb.model.plan import CausalLink, Plan, Step, StepId
from cellwright.kb.model.problem import Problem
from cellwright.kb.terms import ANYTHING, Atom, Function, is_ground, match, substitute_atom, variables

Key = tuple[Hashable, ...]
MAX_UNCERTAIN = 7  # if at most this many atoms are open, every combination is tried


@dataclass(frozen=True)
class Executed:
    """A step and what it did in the canonical order."""

    step: Step
    operator: Operator
    bindings: Bindings
    change: StepChange

    @cached_property
    def denied(self) -> State:
        """The single ground atoms that the step denies."""
        return frozenset(denial.pattern for denial in self.change.denials if denial.consequence is None)

    @cached_property
    def deductions(self) -> tuple[Denial, ...]:
        """The denials that come from deductive operators. Each denies every atom that matches it."""
        return tuple(denial for denial in self.change.denials if denial.consequence is not None)

    @cached_property
    def changed(self) -> Mapping[Key, list[Atom]]:
        """The atoms that change, by their names, and by their names and first arguments."""
        found: dict[Key, list[Atom]] = {}
        for atom in (*self.change.adds, *self.change.ends):
            found.setdefault(("changed", atom.name, None), []).append(atom)
            if atom.arguments:
                found.setdefault(("changed", atom.name, atom.arguments[0]), []).append(atom)
        return found

    def changes(self, pattern: Atom) -> bool:
        """Whether the step changes an atom that matches a pattern."""
        return any(match(pattern, atom, {}) is not None for atom in self.changed.get(_key(pattern), ()))

    def denies(self, atom: Atom, statics: Facts) -> bool:
        """Whether the step denies an atom. The atom need not be true at the moment."""
        return atom in self.denied or any(each.matches(atom, statics) for each in self.deductions)


@dataclass
class Reads:
    """What must not change while a step runs.

    Atoms in `true` must not become false, and atoms in `false` must not become true. Atoms that match a
    pattern in `watched` must not change at all.
    """

    true: set[Atom] = field(default_factory=set)
    false: set[Atom] = field(default_factory=set)
    watched: set[Atom] = field(default_factory=set)


class Mentioned(NamedTuple):
    """The fluent atoms, or patterns of them, that the conditions of a step mention."""

    by_effects: set[Atom]
    by_precondition: set[Atom]
    regions: frozenset[Region]


@dataclass
class Interference:
    """The executed steps of a plan in their canonical order, and which of them come before which."""

    problem: Problem
    plan: Plan
    semantics: Semantics
    executed: Mapping[StepId, Executed]
    order: Precedence
    start: State
    _of_steps: dict[Function, Mentioned] = field(default_factory=dict)

    def conflicts(self) -> Iterator[str]:
        """A message for each pair of unordered steps that disturb each other.

        Such steps may come in either order or overlap.
        """
        steps = list(self.executed.values())
        reads: dict[StepId, Reads] = {}
        deduced = any(each.deductions for each in steps)

        def touched(place: int) -> Touched:
            one = steps[place]
            reads[one.step.id] = self._reads(one)
            return Touched(*map(frozenset, (_changed(one), _exposed(one, reads[one.step.id], deduced))))

        places = loose(self.order, lambda place: self._regions(steps[place]))
        for one, other in (map(steps.__getitem__, each) for each in pairs(self.order, places, touched)):
            problem = self._conflict(one, other, reads) or self._conflict(other, one, reads)
            if problem:
                yield f"steps {other.step.id} and {one.step.id} are unordered, but {problem}"

    def _regions(self, executed: Executed) -> set[Region]:
        """The regions that a step may touch: what it holds and changes, and all that it may depend on.

        Atoms end only where the step denies them.
        """
        found = set(self._mentioned(executed).regions)
        found.update([_region(atom) for atom in executed.change.adds])
        for denial in executed.change.denials:
            found.add(
                _region(denial.pattern) if denial.consequence is None else (denial.pattern.name, ANYTHING)
            )
        for link in self._links_to.get(executed.step.id, ()):
            if not is_stage(link.condition):
                found.add(_region(signed(link.condition)[0]))
        found.update([("", each) for each in executed.step.resources])
        return found

    def _conflict(self, one: Executed, other: Executed, reads: dict[StepId, Reads]) -> str:
        """How `one` disturbs `other`; an empty text if it does not."""
        if one.step.resources and (shared := set(one.step.resources) & set(other.step.resources)):
            return f"both hold {min(map(str, shared))}"
        needed = reads[other.step.id]
        if denied := self._denied(one, (needed.true, other.change.adds)):
            return f"{one.step.operator} denies {min(map(str, denied))}, which {other.step.operator} needs or adds"
        added = needed.false & one.change.adds
        if added:
            return f"{one.step.operator} adds {min(map(str, added))}, which {other.step.operator} needs false"
        if changed := [str(pattern) for pattern in needed.watched if one.changes(pattern)]:
            return f"{one.step.operator} changes {min(changed)}, which {other.step.operator} depends on"
        return ""

    def _denied(self, executed: Executed, exposed: Sequence[Set[Atom]]) -> set[Atom]:
        """The exposed atoms that a step denies and does not add."""
        if executed.deductions:
            atoms = set[Atom]().union(*exposed) - executed.change.adds
            return {atom for atom in atoms if executed.denies(atom, self.semantics.statics)}
        if all(map(executed.denied.isdisjoint, exposed)):
            return set()
        return {atom for atoms in exposed for atom in executed.denied & atoms} - executed.change.adds

    def _reads(self, executed: Executed) -> Reads:
        """What a step depends on: its causal links if they prove the precondition, else all that it mentions."""
        reads = Reads(watched=set(executed.change.triggered))
        for link in self._links_to.get(executed.step.id, ()):
            if not is_stage(link.condition):
                atom, positive = signed(link.condition)
                (reads.true if positive else reads.false).add(atom)
        reads.watched -= reads.true
        operator, bindings = executed.operator, executed.bindings
        mentioned = self._mentioned(executed)
        reads.watched |= mentioned.by_effects
        if not self._proved(operator.precondition, bindings, reads):
            reads.watched |= mentioned.by_precondition
        return reads

    def _mentioned(self, executed: Executed) -> Mentioned:
        """What the conditions of a step can depend on. All steps that are the same have the same."""
        found = self._of_steps.get(executed.step.operator)
        if found is None:
            operator, bindings = executed.operator, executed.bindings
            conditions = [e.condition for e in operator.effects if e.condition != TRUE or e.parameters]
            effects = {each for condition in conditions for each in self.mentioned(condition, bindings)}
            needed = set(self.mentioned(operator.precondition, bindings))
            found = Mentioned(effects, needed, frozenset(map(_region, effects | needed)))
            self._of_steps[executed.step.operator] = found
        return found

    def _proved(self, condition: Condition, bindings: Bindings, reads: Reads) -> bool:
        """Whether the causal links make the condition true in every state that agrees with them.

        Bounds on what is true are tried first. If they are too coarse and few atoms are open, every such
        state is tried.
        """
        if condition == TRUE:
            return True
        possible = self._possible.after(reads.false, frozenset()) if reads.false else self._possible
        lower, upper = self.semantics.bounds(reads.true, possible)
        if holds(condition, lower, bindings, upper):
            return True
        behind = {
            name for each in literals(condition) for name in self.semantics.fluents_behind(each.atom.name)
        }
        open_ = self.everything - reads.false - reads.true
        uncertain = sorted((atom for atom in open_ if atom.name in behind), key=str)
        if len(uncertain) > MAX_UNCERTAIN:
            return False
        states = itertools.chain.from_iterable(
            itertools.combinations(uncertain, size) for size in range(len(uncertain) + 1)
        )
        return all(holds(condition, self.semantics.facts((*reads.true, *more)), bindings) for more in states)

    @cached_property
    def _links_to(self) -> Mapping[StepId, list[CausalLink]]:
        found: dict[StepId, list[CausalLink]] = {}
        for link in self.plan.links:
            found.setdefault(link.consumer, []).append(link)
        return found

    @cached_property
    def everything(self) -> State:
        """Every atom that is true at some time."""
        return self.start.union(*(executed.change.adds for executed in self.executed.values()))

    @cached_property
    def _possible(self) -> Facts:
        """The same, as facts."""
        return Facts(self.everything)

    def mentioned(self, condition: Condition, bindings: Bindings) -> Iterator[Atom]:
        """The fluent atoms, or patterns of them, on which a condition can depend."""
        for literal in literals(bind(condition, bindings)):
            atom = literal.atom
            fluents = self.semantics.fluents_behind(atom.name)
            if fluents == {atom.name}:
                yield substitute_atom(atom, dict.fromkeys(variables(atom), ANYTHING))
            else:
                yield from (atom_pattern(self.problem, name) for name in sorted(fluents))


def _changed(executed: Executed) -> Iterator[Key]:
    """What a step changes: resources that it holds, atoms that it denies or adds, and patterns of what it changes."""
    yield from (("held", each) for each in executed.step.resources)
    yield from (("true", each) for each in executed.denied)
    yield from (("of", each.pattern.name) for each in executed.deductions)
    yield from (("false", each) for each in executed.change.adds)
    yield from executed.changed


def _exposed(executed: Executed, reads: Reads, deduced: bool) -> Iterator[Key]:
    """Where others can disturb a step: each is among what they change, if they do. Whether any step denies by deduction is known."""
    yield from (("held", each) for each in executed.step.resources)
    for atom in (*reads.true, *executed.change.adds):
        yield "true", atom
        if deduced:
            yield "of", atom.name
    yield from (("false", each) for each in reads.false)
    yield from map(_key, reads.watched)


def _region(pattern: Atom) -> Region:
    """The region of an atom, or of all atoms that match a pattern."""
    if not pattern.arguments:
        return (pattern.name, None)
    first = pattern.arguments[0]
    return (pattern.name, first if is_ground(first) else ANYTHING)


def _key(pattern: Atom) -> Key:
    """The key of the changed atoms of which some may match a pattern."""
    first = pattern.arguments[0] if pattern.arguments and is_ground(pattern.arguments[0]) else None
    return "changed", pattern.name, first


def atom_pattern(problem: Problem, name: str) -> Atom:
    """A pattern that matches every atom of a predicate."""
    return Function(name, (ANYTHING,) * len(problem.domain.predicates[name].arguments))


def signed(condition: Atom) -> tuple[Atom, bool]:
    """The atom of a condition, and whether it must be true: `not(p)` is the condition that p is false."""
    if (
        condition.name == "not"
        and len(condition.arguments) == 1
        and isinstance(condition.arguments[0], Function)
    ):
        return condition.arguments[0], False
    return condition, True


def is_stage(condition: Atom) -> bool:
    """Whether a condition counts the stages of a chain.

    The workflow check handles such conditions by itself.
    """
    return signed(condition)[0].name == "_stage" if condition.name == "not" else condition.name == "_stage"
