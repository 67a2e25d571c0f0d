"""A cell in which causes of an exception are there: what they do to the world, and what tests and repairs do in it.

Everything is a function of a state and of the causes, so that a true world and every belief about it follow the same rules.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace

from cellwright.engine.pipelines.barring import barred
from cellwright.engine.pipelines.simulation.dynamics import Dynamics, Move, WorldState, fits
from cellwright.engine.stages.diagnosis.revision import Binding, bound
from cellwright.engine.stages.validation.semantics import Semantics
from cellwright.kb.model.faults import FaultModel, FaultTest, Repair
from cellwright.kb.model.plan import Plan, StepId
from cellwright.kb.terms import (
    ANYTHING,
    Atom,
    Function,
    Term,
    Variable,
    is_ground,
    substitute,
    substitute_atom,
    variables,
)

Causes = tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Achievement:
    """A step that is done: the facts and events that it brought about, and the stages that were reached with it."""

    id: StepId
    step: Function
    added: tuple[Atom, ...] = ()
    moved: tuple[Move, ...] = ()


@dataclass(frozen=True, slots=True)
class Memory:
    """What of the steps that are done a fault base can come back to: the names of what causes spoil, and of steps since when."""

    doubted: frozenset[str] = frozenset()
    since: frozenset[str] = frozenset()

    @classmethod
    def of(cls, model: FaultModel | None) -> "Memory":
        """What a fault base can come back to; nothing without one."""
        causes = () if model is None else tuple(model.causes.values())
        return cls(
            frozenset(atom.name for cause in causes for atom in cause.spoils),
            frozenset(step.name for cause in causes for step in cause.since),
        )

    def keeps(self, work: Achievement) -> bool:
        """Whether a step that is done may matter later."""
        if not self.doubted:
            return False
        achieved = (*work.added, *(atom for _, _, atom in work.moved))
        return work.step.name in self.since or any(atom.name in self.doubted for atom in achieved)


@dataclass(frozen=True)
class FaultyCell:
    """A cell in which a step got an exceptional reply. `done` are the steps before it, in order.

    A step changes nothing where its precondition does not hold, or where a cause that is there blocks it.
    """

    dynamics: Dynamics
    model: FaultModel
    exception: str
    binding: Binding
    interrupted: Function | None = None
    done: tuple[Achievement, ...] = ()
    _limited: dict[frozenset[str], Semantics] = field(default_factory=dict, compare=False)

    def begun(self, before: WorldState, causes: Causes) -> WorldState:
        """The state when the exception is noticed: what the causes say of it, `before` being the state before the step."""
        state = before
        if self.interrupted is not None and any(self.model.causes[each].completes for each in causes):
            refused = self.dynamics.refusal(self.interrupted, state)
            state = state if refused else self.dynamics.after(self.interrupted, state)
        state = self._reopened(state, causes)
        for each in causes:
            entry = self.model.causes[each]
            state = self.dynamics.changed(state, self._bound(entry.denies), self._bound(entry.adds))
        return state

    def taken(self, state: WorldState, causes: Causes, step: Function) -> WorldState:
        """The state after somebody has had a step taken, whether it could be or not.

        What it achieves of the facts that the causes put in doubt does not count.
        """
        if self.failing(causes, step) or self.dynamics.refusal(step, state):
            return state
        after, added, moves = self.dynamics.effects(step, state)
        patterns = [pattern for cause in causes for pattern in self.patterns(cause)]
        vain = [atom for atom in added if _any_fits(patterns, atom) and atom not in state.facts]
        reached = dict(after.reached)
        for name, number, atom in moves:
            if _any_fits(patterns, atom):
                reached[name] = min(reached[name], number - 1)
        return replace(self.dynamics.changed(after, vain, ()), reached=reached)

    def cured(self, state: WorldState, repair: Repair) -> WorldState:
        """The state after a repair has helped."""
        return self.dynamics.changed(state, self._bound(repair.denies), self._bound(repair.adds))

    def failing(self, causes: Causes, step: Function) -> str:
        """The cause that makes a step fail which exists; empty if none does."""
        if isinstance(self.dynamics.semantics.binding(step), str):
            return ""
        return next((cause for cause in causes if self._fails(cause, step)), "")

    def blocked(self, cause: str) -> tuple[Function, ...]:
        """The steps that fail while a cause is there, as patterns; the interrupted step is one of them if there are any.

        So do those whose work would not count, because the cause puts it in doubt.
        """
        said = (*self.model.blocked(cause, self.exception), *self._vain(cause))
        patterns = tuple(dict.fromkeys(self._step(each) for each in said))
        step = self.interrupted
        named = not patterns or step is None or _any_fits(patterns, step)
        return patterns if named or step is None else (*patterns, step)

    def lost(self, cause: str) -> tuple[Term, ...]:
        """The resources that are lost with a cause."""
        return tuple(substitute(term, self.binding) for term in self.model.causes[cause].loses)

    def given_up(self, repair: Repair) -> tuple[Term, ...]:
        """The resources that a repair goes on without."""
        return tuple(substitute(term, self.binding) for term in repair.loses)

    def patterns(self, cause: str) -> tuple[Atom, ...]:
        """The facts and events of earlier steps that a cause puts in doubt, as patterns."""
        return self._bound(self.model.causes[cause].spoils)

    def carried_out_by(self, action: FaultTest | Repair) -> Function | None:
        """The step that carries out a test or a repair; None if it is no step, or something in it is not known."""
        step = substitute_atom(action.by, self.binding) if action.by is not None else None
        return step if step is not None and is_ground(step) else None

    def spoilt(self, cause: str) -> tuple[tuple[Achievement, ...], tuple[Achievement, ...]]:
        """The steps whose work a cause puts in doubt, and those whose like work stands: what was done before `since`."""
        entry = self.model.causes[cause]
        patterns, since = self.patterns(cause), self._bound(entry.since)
        last = max((n for n, each in enumerate(self.done) if _any_fits(since, each.step)), default=-1)
        touched = [_like(each, patterns) for each in self.done]
        return tuple(a for a in touched[last + 1 :] if a), tuple(a for a in touched[: last + 1] if a)

    def _vain(self, cause: str) -> Iterator[Function]:
        for operator in self.dynamics.problem.domain.operators:
            for effect in operator.effects:
                for pattern in self.patterns(cause):
                    found = _unified(effect.atom, pattern) if effect.adds else None
                    if found is not None:
                        yield Function(
                            operator.name, tuple(found.get(v, ANYTHING) for v in operator.variables)
                        )

    def _step(self, pattern: Function) -> Function:
        """A pattern of steps with the interrupted step's arguments; what it does not bind is anything."""
        known = substitute_atom(pattern, self.binding)
        return substitute_atom(known, dict.fromkeys(variables(known), ANYTHING))

    def _fails(self, cause: str, step: Function) -> bool:
        return _any_fits(self.blocked(cause), step) or isinstance(
            self._without_lost(cause).binding(step), str
        )

    def _without_lost(self, cause: str) -> Semantics:
        """What steps mean without the resources that are lost with a cause."""
        lost = frozenset(map(str, self.lost(cause)))
        if lost not in self._limited:
            self._limited[lost] = (
                Semantics(barred(self.dynamics.problem, lost)) if lost else self.dynamics.semantics
            )
        return self._limited[lost]

    def _reopened(self, state: WorldState, causes: Causes) -> WorldState:
        """The state without the work that the causes put in doubt."""
        spoilt = [work for cause in causes for work in self.spoilt(cause)[0]]
        gone = [atom for work in spoilt for atom in work.added]
        reached = dict(state.reached)
        for work in spoilt:
            for chain, number, _ in work.moved:
                reached[chain] = min(reached[chain], number - 1)
        return replace(self.dynamics.changed(state, gone, ()), reached=reached)

    def _bound(self, atoms: Iterable[Atom]) -> tuple[Atom, ...]:
        return bound(atoms, self.binding)


def history(
    dynamics: Dynamics, plan: Plan, done: Sequence[StepId]
) -> tuple[WorldState, tuple[Achievement, ...]]:
    """The state after some steps of a plan if each did what it should, and what each of them has achieved."""
    state, names = dynamics.start(), set(done)
    achieved = []
    for step in plan.steps:
        if step.id in names:
            after, added, moves = dynamics.effects(step.operator, state)
            new = tuple(atom for atom in added if atom not in state.facts)
            achieved.append(Achievement(step.id, step.operator, new, moves))
            state = after
    return state, tuple(achieved)


def _unified(effect: Term, pattern: Term) -> dict[Variable, Term] | None:
    """What the variables of an effect must be so that it fits a pattern; None if it cannot."""
    if isinstance(pattern, Variable):
        return {}
    if isinstance(effect, Variable):
        return {effect: pattern}
    if not isinstance(effect, Function) or not isinstance(pattern, Function):
        return {} if effect == pattern else None
    if (effect.name, len(effect.arguments)) != (pattern.name, len(pattern.arguments)):
        return None
    parts = [_unified(a, b) for a, b in zip(effect.arguments, pattern.arguments, strict=True)]
    if any(part is None for part in parts):
        return None
    return {variable: term for part in parts if part for variable, term in part.items()}


def _any_fits(patterns: Iterable[Function], step: Function) -> bool:
    return any(fits(pattern, step) for pattern in patterns)


def _like(work: Achievement, patterns: Sequence[Atom]) -> Achievement | None:
    """The part of a step's work that fits one of some patterns; None if nothing does."""
    added = tuple(atom for atom in work.added if _any_fits(patterns, atom))
    moved = tuple(each for each in work.moved if _any_fits(patterns, each[2]))
    return replace(work, added=added, moved=moved) if added or moved else None
