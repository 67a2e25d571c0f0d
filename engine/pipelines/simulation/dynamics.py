"""States of a cell, and what steps and sudden changes make of them, by the meaning that the checker gives to a domain."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache

from engine.stages.validation.changes import Denial, State
from engine.stages.validation.datalog import Facts, holds, solve
from engine.stages.validation.semantics import Semantics
from kb.model.conditions import Literal, goal_parts
from kb.model.problem import Problem
from kb.model.workflow import advanced
from kb.terms import Atom, Function, is_ground, match, substitute_atom

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
        return WorldState(self.semantics.initial(), {chain.name: 0 for chain in self.problem.chains})

    def facts(self, state: WorldState) -> Facts:
        """The facts of a state with those that follow by rules."""
        return self._derived(state.facts)

    def refusal(self, step: Function, state: WorldState) -> str:
        """Why a step cannot be taken in a state; nothing if it can."""
        found = self.semantics.binding(step)
        if isinstance(found, str):
            return found
        operator, bindings = found
        if not holds(operator.precondition, self.facts(state), bindings):
            return f"its precondition does not hold: {operator.precondition}"
        return ""

    def after(self, step: Function, state: WorldState) -> WorldState:
        """The state after a step that can be taken; chains move on as soon as they may."""
        return self.effects(step, state)[0]

    def effects(
        self, step: Function, state: WorldState
    ) -> tuple[WorldState, tuple[Atom, ...], dict[str, Atom]]:
        """The state after a step, what the step adds, events included, and for each chain that it moves what moves it.

        Raises `ValueError` if there is no such step.
        """
        found = self.semantics.binding(step)
        if isinstance(found, str):
            raise ValueError(found)
        change = self.semantics.change(*found, self.facts(state), state.facts)
        moved, _ = advanced(self.problem.chains, state.reached, change.events, change.adds)
        reached = {name: number + (name in moved) for name, number in state.reached.items()}
        facts = (state.facts - change.ends) | change.adds
        return WorldState(facts, reached), (*change.adds, *change.events), moved

    def changed(self, state: WorldState, denied: Iterable[Atom], added: Iterable[Atom]) -> WorldState:
        """The state after something has happened by itself, with all that follows by deductive operators.

        What fits a pattern in `denied` ends; then each ground atom of `added` becomes true, one after another, so that the
        last one counts where two exclude each other.
        """
        patterns = tuple(denied)
        gone = sorted((f for f in state.facts if any(fits(pattern, f) for pattern in patterns)), key=str)
        denials = tuple(Denial(atom, deduced=False) for atom in gone)
        facts = self._deduced(state.facts, (), denials)
        for atom in added:
            if is_ground(atom):
                facts = self._deduced(facts, (atom,), ())
        return replace(state, facts=facts)

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
            if bindings is None:
                continue
            fluents = [
                p for p in rule.body if isinstance(p, Literal) and self.semantics.fluents_behind(p.atom.name)
            ]
            static = tuple(part for part in rule.body if part not in fluents)
            for solved in solve(static, self.semantics.statics, bindings):
                named = [substitute_atom(each.atom, solved) for each in fluents if each.positive]
                return [fact for each in named for fact in self._grounds(each)]
        return []

    def _deduced(self, facts: State, added: tuple[Atom, ...], denials: tuple[Denial, ...]) -> State:
        change = self.semantics.deduce(added, denials, facts)
        return (facts - change.ends) | change.adds


def fits(pattern: Atom, fact: Atom) -> bool:
    """Whether a fact is an instance of a pattern; variables stand for anything."""
    return match(pattern, fact, {}) is not None
