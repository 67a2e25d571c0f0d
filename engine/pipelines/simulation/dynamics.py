"""States of a cell, and what steps and sudden changes make of them, by the meaning that the checker gives to a domain."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache

from cellwright.engine.model.task import Task
from cellwright.engine.stages.grounding import ground
from cellwright.engine.stages.validation.changes import Denial, State, StepChange
from cellwright.engine.stages.validation.datalog import holds, solve
from cellwright.engine.stages.validation.facts import Facts
from cellwright.engine.stages.validation.semantics import Semantics
from cellwright.kb.model.conditions import Condition, Literal, StateAggregate, goal_parts
from cellwright.kb.model.problem import Problem
from cellwright.kb.model.workflow import Listed, advanced, begun, holding, reached_as
from cellwright.kb.terms import Atom, Function, Term, Variable, is_ground, match, ordered, substitute_atom

Move = tuple[str, int, Atom]  # a chain, the number of its stage that is reached, and the atom that reaches it

KEPT = 256  # states whose derived facts are kept


@dataclass(frozen=True, slots=True)
class WorldState:
    """The facts that are true, and for each chain of the workflow how many of its stages are reached."""

    facts: State
    reached: Mapping[str, int] = field(default_factory=dict)

    def common(self, other: "WorldState") -> "WorldState":
        """What is sure if the world is in one of two states."""
        reached = {name: min(number, other.reached[name]) for name, number in self.reached.items()}
        return WorldState(self.facts & other.facts, reached)


class Dynamics:
    """What changes the states of one problem."""

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self.semantics = Semantics(problem)
        self._derived = lru_cache(KEPT)(self.semantics.facts)

    def start(self) -> WorldState:
        """The state in which the problem begins."""
        facts = self.semantics.initial()
        return WorldState(facts, begun(self.problem.chains, holding(Listed(facts))))

    def facts(self, state: WorldState) -> Facts:
        """The facts of a state with those that follow by rules."""
        return self._derived(state.facts)

    def refusal(self, step: Function, state: WorldState) -> str:
        """Why a step cannot be taken in a state; nothing if it can."""
        found = self.semantics.binding(step)
        if isinstance(found, str):
            return found
        operator, bindings = found
        facts, wanted = self.facts(state), operator.precondition
        if not holds(wanted, facts, bindings):
            missing = [
                _said(part, bindings) for part in goal_parts(wanted) if not holds(part, facts, bindings)
            ]
            return f"its precondition does not hold: {', '.join(missing) or wanted}"
        return ""

    def after(self, step: Function, state: WorldState) -> WorldState:
        """The state after a step that can be taken; chains move on as soon as they may."""
        return self.effects(step, state)[0]

    def effects(
        self, step: Function, state: WorldState
    ) -> tuple[WorldState, tuple[Atom, ...], tuple[Move, ...]]:
        """The state after a step, what the step adds, events included, and the stages that are reached with it.

        Raises `ValueError` if there is no such step.
        """
        found = self.semantics.binding(step)
        if isinstance(found, str):
            raise ValueError(found)
        change = self.semantics.change(*found, self.facts(state), state.facts)
        facts = (state.facts - change.ends) | change.adds
        reached, _ = advanced(self.problem.chains, state.reached, change.events, holding(Listed(facts)))
        added = (*change.adds, *change.events)
        moves = self._moves(state.reached, reached, (*change.events, *facts))
        return WorldState(facts, reached), added, tuple(moves)

    def _moves(
        self, before: Mapping[str, int], after: Mapping[str, int], true: Sequence[Atom]
    ) -> Iterator[Move]:
        for chain in self.problem.chains:
            for number in range(before[chain.name], after[chain.name]):
                yield chain.name, number + 1, reached_as(chain.stages[number], true)

    def changed(self, state: WorldState, denied: Iterable[Atom], added: Iterable[Atom]) -> WorldState:
        """The state after something has happened by itself, with all that follows by deductive operators.

        What fits a pattern in `denied` ends; then each ground atom of `added` becomes true, one after another, so that the
        last one counts where two exclude each other.
        """
        patterns = tuple(denied)
        gone = sorted((f for f in state.facts if any(fits(pattern, f) for pattern in patterns)), key=str)
        facts = self.asserted(state.facts, (), gone)
        for atom in added:
            facts = self.asserted(facts, (atom,)) if is_ground(atom) else facts
        return replace(state, facts=facts)

    def asserted(self, facts: State, added: Sequence[Atom], gone: Sequence[Atom] = ()) -> State:
        """Facts after some came true and others ended, with all that follows.

        What is added counts for more than what follows from the end of something: if another tool is held now, the hand is
        not empty because the old one has left it. A quantity has its new value only.
        """
        gone = (*gone, *self._values_before(facts, added))
        direct = self.semantics.deduce(added, (), frozenset())
        ending = [Denial(atom, deduced=False) for atom in gone]
        change = self.semantics.deduce(added, tuple(ending), facts)
        if displaced := self.displaced(facts - change.ends, change.adds - self._overruled(change, direct)):
            ending += [Denial(atom, deduced=False) for atom in displaced]
            change = self.semantics.deduce(added, tuple(ending), facts)
        return ((facts - change.ends) | change.adds) - self._overruled(change, direct)

    def _values_before(self, facts: State, added: Sequence[Atom]) -> tuple[Atom, ...]:
        """The values that quantities have in place of those that are added."""
        known = self.problem.domain.quantities
        new = {(each.name, each.arguments[:-1]): each for each in added if each.name in known}
        return ordered(
            each
            for each in facts
            if each.name in known and new.get((each.name, each.arguments[:-1]), each) != each
        )

    def _overruled(self, change: StepChange, direct: StepChange) -> State:
        """What follows in a change but is denied by what was added itself."""
        implied = change.adds - direct.adds
        return frozenset(
            a for a in implied if any(d.matches(a, self.semantics.statics) for d in direct.denials)
        )

    def displaced(self, facts: State, added: Iterable[Atom]) -> tuple[Atom, ...]:
        """The facts that cannot stand beside new ones, because they would have denied them: a full hand, if it is empty now.

        A fact that denies another one only when it comes about is none of these: both can be true one after the other.
        """
        new = frozenset(added) - facts
        old = facts - new
        denied = ((each, self.semantics.deduce((each,), (), new).ends & new) for each in old if new)
        return ordered(each for each, ends in denied if any(self._exclusive(each, other) for other in ends))

    def _exclusive(self, one: Atom, other: Atom) -> bool:
        """Whether two atoms are never true at once, as far as steps can make them true at all."""
        numbers = self._task[1]
        if one not in numbers or other not in numbers:
            return True
        both = 1 << numbers[one] | 1 << numbers[other]
        return any(group & both == both for group in self._task[0].mutex_groups)

    @cached_property
    def _task(self) -> tuple[Task, dict[Atom, int]]:
        task = ground(self.problem)
        return task, {atom: number for number, atom in enumerate(task.atoms)}

    def presupposed(self, step: Function, state: WorldState) -> WorldState:
        """The state, corrected so that a step can have begun in it; as it is if that cannot be told from its precondition.

        Facts that the precondition names are made true or untrue; of a derived one, the facts under the first rule for it.
        """
        found = self.semantics.binding(step)
        if isinstance(found, str) or not self.refusal(step, state):
            return state
        operator, bindings = found
        added: list[Atom] = []
        denied: list[Atom] = []
        for part in goal_parts(operator.precondition):
            if isinstance(part, Literal):
                (added if part.positive else denied).append(substitute_atom(part.atom, bindings))
        missing = [fact for atom in added for fact in self._grounds(atom) if fact not in state.facts]
        corrected = self.changed(state, denied, missing)
        return corrected if not self.refusal(step, corrected) else state

    def _grounds(self, atom: Atom) -> list[Atom]:
        """The fluents that an atom needs: itself, or what the first rule for it names whose static part holds."""
        if self.semantics.fluents_behind(atom.name) == {atom.name}:
            return [atom]
        for rule in self.problem.domain.rules:
            bindings = match(rule.head, atom, {})
            if bindings is None or any(isinstance(part, StateAggregate) for part in rule.body):
                continue
            fluents = [
                p for p in rule.body if isinstance(p, Literal) and self.semantics.fluents_behind(p.atom.name)
            ]
            static = tuple(part for part in rule.body if part not in fluents)
            for solved in solve(static, self.semantics.statics, bindings):
                named = [substitute_atom(each.atom, solved) for each in fluents if each.positive]
                return [fact for each in named for fact in self._grounds(each)]
        return []


def fits(pattern: Atom, fact: Atom) -> bool:
    """Whether a fact is an instance of a pattern; variables stand for anything."""
    return match(pattern, fact, {}) is not None


def _said(part: Condition, bindings: Mapping[Variable, Term]) -> str:
    """A condition of a step with its objects in it."""
    if not isinstance(part, Literal):
        return str(part)
    return str(replace(part, atom=substitute_atom(part.atom, bindings)))
