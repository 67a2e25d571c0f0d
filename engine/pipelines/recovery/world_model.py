"""World model of a cell: how steps, tests, repairs and causes of exceptions change its state."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache

from cellwright.engine.model.ground_task import GroundTask
from cellwright.engine.pipelines.planning.restrictions import forbid_steps
from cellwright.engine.stages.diagnosis.belief_revision import Binding, bind_atoms
from cellwright.engine.stages.grounding import ground
from cellwright.engine.stages.validation.checker_facts import CheckerFacts
from cellwright.engine.stages.validation.condition_solving import condition_holds, solve_conditions
from cellwright.engine.stages.validation.operator_semantics import Semantics
from cellwright.engine.stages.validation.step_changes import CheckedChange, Denial, State
from cellwright.kb.model.conditions import Condition, Literal, StateAggregate, goal_parts
from cellwright.kb.model.fault_model import FaultModel, FaultTest, Repair
from cellwright.kb.model.plan_model import Plan, StepId
from cellwright.kb.model.planning_problem import (
    Listed,
    Problem,
    advance_chains,
    initial_progress,
    reached_as,
    stage_holds,
)
from cellwright.kb.terms import (
    ANYTHING,
    Atom,
    Function,
    Term,
    Variable,
    is_ground,
    match_term,
    sort_naturally,
    substitute_atom,
    substitute_term,
    term_variables,
)

# a chain, the number of its stage that is reached, and the atom that reaches it
Move = tuple[str, int, Atom]

MAX_KEPT_STATES = 256  # states whose derived facts are kept


@dataclass(frozen=True, slots=True)
class WorldState:
    """The facts that are true, and for each chain of the workflow how many of its stages are
    reached.
    """

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
        self._derived = lru_cache(MAX_KEPT_STATES)(self.semantics.facts)

    def start(self) -> WorldState:
        """The state in which the problem begins."""
        facts = self.semantics.initial()
        return WorldState(facts, initial_progress(self.problem.chains, stage_holds(Listed(facts))))

    def facts(self, state: WorldState) -> CheckerFacts:
        """The facts of a state with those that follow by rules."""
        return self._derived(state.facts)

    def refusal(self, step: Function, state: WorldState) -> str:
        """Why a step cannot be taken in a state; nothing if it can."""
        bound_operator = self.semantics.binding(step)
        if isinstance(bound_operator, str):
            return bound_operator
        operator, bindings = bound_operator
        facts, condition = self.facts(state), operator.precondition
        if not condition_holds(condition, facts, bindings):
            missing = [
                _condition_text(part, bindings)
                for part in goal_parts(condition)
                if not condition_holds(part, facts, bindings)
            ]
            return f"its precondition does not hold: {', '.join(missing) or condition}"
        return ""

    def after(self, step: Function, state: WorldState) -> WorldState:
        """The state after a step that can be taken; chains move on as soon as they may."""
        return self.effects(step, state)[0]

    def effects(
        self, step: Function, state: WorldState
    ) -> tuple[WorldState, tuple[Atom, ...], tuple[Move, ...]]:
        """The state after a step, what the step adds, events included, and the stages that are
        reached with it.

        Raises `ValueError` if there is no such step.
        """
        bound_operator = self.semantics.binding(step)
        if isinstance(bound_operator, str):
            raise ValueError(bound_operator)
        change = self.semantics.change(*bound_operator, self.facts(state), state.facts)
        facts = (state.facts - change.ends) | change.adds
        reached, _ = advance_chains(
            self.problem.chains, state.reached, change.events, stage_holds(Listed(facts))
        )
        added = (*change.adds, *change.events)
        moves = self._moves(state.reached, reached, (*change.events, *facts))
        return WorldState(facts, reached), added, tuple(moves)

    def _moves(
        self, before: Mapping[str, int], after: Mapping[str, int], true: Sequence[Atom]
    ) -> Iterator[Move]:
        for chain in self.problem.chains:
            for number in range(before[chain.name], after[chain.name]):
                yield chain.name, number + 1, reached_as(chain.stages[number], true)

    def changed(
        self, state: WorldState, denied: Iterable[Atom], added: Iterable[Atom]
    ) -> WorldState:
        """The state after something has happened by itself, with all that follows by deductive
        operators.

        What fits a pattern in `denied` ends; then each ground atom of `added` becomes true, one
        after another, so that the last one counts where two exclude each other.
        """
        patterns = tuple(denied)
        gone = sorted(
            (f for f in state.facts if any(is_instance(pattern, f) for pattern in patterns)),
            key=str,
        )
        facts = self.asserted(state.facts, (), gone)
        for atom in added:
            facts = self.asserted(facts, (atom,)) if is_ground(atom) else facts
        return replace(state, facts=facts)

    def asserted(self, facts: State, added: Sequence[Atom], gone: Sequence[Atom] = ()) -> State:
        """Facts after some came true and others ended, with all that follows.

        What is added counts for more than what follows from the end of something: if another tool
        is held now, the hand is not empty because the old one has left it. A quantity has its new
        value only.
        """
        gone = (*gone, *self._values_before(facts, added))
        direct = self.semantics.deduce(added, (), frozenset())
        ending = [Denial(atom, deduced=False) for atom in gone]
        change = self.semantics.deduce(added, tuple(ending), facts)
        if displaced := self.displaced(
            facts - change.ends, change.adds - self._overruled(change, direct)
        ):
            ending += [Denial(atom, deduced=False) for atom in displaced]
            change = self.semantics.deduce(added, tuple(ending), facts)
        return ((facts - change.ends) | change.adds) - self._overruled(change, direct)

    def _values_before(self, facts: State, added: Sequence[Atom]) -> tuple[Atom, ...]:
        """The values that quantities have in place of those that are added."""
        quantities = self.problem.domain.quantities
        new = {(atom.name, atom.arguments[:-1]): atom for atom in added if atom.name in quantities}
        return sort_naturally(
            atom
            for atom in facts
            if atom.name in quantities and new.get((atom.name, atom.arguments[:-1]), atom) != atom
        )

    def _overruled(self, change: CheckedChange, direct: CheckedChange) -> State:
        """What follows in a change but is denied by what was added itself."""
        implied = change.adds - direct.adds
        return frozenset(
            a for a in implied if any(d.matches(a, self.semantics.statics) for d in direct.denials)
        )

    def displaced(self, facts: State, added: Iterable[Atom]) -> tuple[Atom, ...]:
        """The facts that cannot stand beside new ones, because they would have denied them: a full
        hand, if it is empty now.

        A fact that denies another one only when it comes about is none of these: both can be true
        one after the other.
        """
        new = frozenset(added) - facts
        old = facts - new
        denied = ((atom, self.semantics.deduce((atom,), (), new).ends & new) for atom in old if new)
        return sort_naturally(
            atom for atom, ends in denied if any(self._exclusive(atom, ended) for ended in ends)
        )

    def _exclusive(self, one: Atom, other: Atom) -> bool:
        """Whether two atoms are never true at once, as far as steps can make them true at all."""
        numbers = self._task[1]
        if one not in numbers or other not in numbers:
            return True
        both = 1 << numbers[one] | 1 << numbers[other]
        return any(group & both == both for group in self._task[0].mutex_groups)

    @cached_property
    def _task(self) -> tuple[GroundTask, dict[Atom, int]]:
        task = ground(self.problem)
        return task, {atom: number for number, atom in enumerate(task.atoms)}

    def presupposed(self, step: Function, state: WorldState) -> WorldState:
        """The state, corrected so that a step can have begun in it; as it is if that cannot be told
        from its precondition.

        Facts that the precondition names are made true or untrue; of a derived one, the facts under
        the first rule for it.
        """
        bound_operator = self.semantics.binding(step)
        if isinstance(bound_operator, str) or not self.refusal(step, state):
            return state
        operator, bindings = bound_operator
        added: list[Atom] = []
        denied: list[Atom] = []
        for part in goal_parts(operator.precondition):
            if isinstance(part, Literal):
                (added if part.positive else denied).append(substitute_atom(part.atom, bindings))
        missing = [
            fact for atom in added for fact in self._grounds(atom) if fact not in state.facts
        ]
        corrected = self.changed(state, denied, missing)
        return corrected if not self.refusal(step, corrected) else state

    def _grounds(self, atom: Atom) -> list[Atom]:
        """The fluents that an atom needs: itself, or what the first rule for it names whose
        static part holds.
        """
        if self.semantics.fluents_behind(atom.name) == {atom.name}:
            return [atom]
        for rule in self.problem.domain.rules:
            bindings = match_term(rule.head, atom, {})
            if bindings is None or any(isinstance(part, StateAggregate) for part in rule.body):
                continue
            fluents = [
                p
                for p in rule.body
                if isinstance(p, Literal) and self.semantics.fluents_behind(p.atom.name)
            ]
            static = tuple(part for part in rule.body if part not in fluents)
            for solved in solve_conditions(static, self.semantics.statics, bindings):
                named = [
                    substitute_atom(fluent.atom, solved) for fluent in fluents if fluent.positive
                ]
                return [fact for atom in named for fact in self._grounds(atom)]
        return []


def is_instance(pattern: Atom, fact: Atom) -> bool:
    """Whether a fact is an instance of a pattern; variables stand for anything."""
    return match_term(pattern, fact, {}) is not None


def _condition_text(part: Condition, bindings: Mapping[Variable, Term]) -> str:
    """A condition of a step with its objects in it."""
    if not isinstance(part, Literal):
        return str(part)
    return str(replace(part, atom=substitute_atom(part.atom, bindings)))


Causes = tuple[str, ...]


@dataclass(frozen=True, slots=True)
class StepAchievement:
    """A step that is done: the facts and events that it brought about, and the stages that were
    reached with it.
    """

    id: StepId
    step: Function
    added: tuple[Atom, ...] = ()
    moved: tuple[Move, ...] = ()


@dataclass(frozen=True, slots=True)
class KeptHistory:
    """What of the steps that are done a fault base can come back to: the names of what causes
    spoil, and of steps since when.
    """

    doubted: frozenset[str] = frozenset()
    since: frozenset[str] = frozenset()

    @classmethod
    def of(cls, model: FaultModel | None) -> "KeptHistory":
        """What a fault base can come back to; nothing without one."""
        causes = () if model is None else tuple(model.causes.values())
        return cls(
            frozenset(atom.name for cause in causes for atom in cause.spoils),
            frozenset(step.name for cause in causes for step in cause.since),
        )

    def keeps(self, work: StepAchievement) -> bool:
        """Whether a step that is done may matter later."""
        if not self.doubted:
            return False
        achieved = (*work.added, *(atom for _, _, atom in work.moved))
        return work.step.name in self.since or any(atom.name in self.doubted for atom in achieved)


@dataclass(frozen=True)
class FaultyCell:
    """A cell in which a step got an exceptional reply. `done` are the steps before it, in order.

    A step changes nothing where its precondition does not hold, or where a cause that is there
    blocks it.
    """

    dynamics: Dynamics
    model: FaultModel
    exception: str
    binding: Binding
    interrupted: Function | None = None
    done: tuple[StepAchievement, ...] = ()
    _limited: dict[frozenset[str], Semantics] = field(default_factory=dict, compare=False)

    def begun(self, before: WorldState, causes: Causes) -> WorldState:
        """The state when the exception is noticed: what the causes say of it, `before` being
        the state before the step.
        """
        state = before
        if self.interrupted is not None and any(
            self.model.causes[cause].completes for cause in causes
        ):
            refused = self.dynamics.refusal(self.interrupted, state)
            state = state if refused else self.dynamics.after(self.interrupted, state)
        state = self._reopened(state, causes)
        for hidden_cause in causes:
            entry = self.model.causes[hidden_cause]
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
        """The steps that fail while a cause is there, as patterns; the interrupted step is one of
        them if there are any.

        So do those whose work would not count, because the cause puts it in doubt.
        """
        blocked_steps = (*self._said(cause), *self._vain(cause))
        patterns = tuple(dict.fromkeys(self._step(pattern) for pattern in blocked_steps))
        step = self.interrupted
        named = not patterns or step is None or _any_fits(patterns, step)
        return patterns if named or step is None else (*patterns, step)

    def _said(self, cause: str) -> tuple[Function, ...]:
        """What a cause blocks by the fault base.

        If that is the interrupted operator by default, and the cause puts something in doubt, it is
        about certain things: objects of the domain, and arguments of the step. Then it blocks the
        steps of the operator with the same of these things as the interrupted step has; that step
        alone if it has none of them.
        """
        entry, step = self.model.causes[cause], self.interrupted
        patterns = self.model.blocked(cause, self.exception)
        if entry.blocks is not None or step is None or not patterns or not entry.doubts:
            return patterns
        problem = self.dynamics.problem
        objects = {Function(name) for name in (*problem.domain.objects, *problem.objects)}
        named = {part for atom in self._bound(entry.doubts) for part in _parts(atom)}
        same = _about(step, named & objects)
        return (same if isinstance(same, Function) and same != step else step,)

    def lost(self, cause: str) -> tuple[Term, ...]:
        """The resources that are lost with a cause."""
        return tuple(substitute_term(term, self.binding) for term in self.model.causes[cause].loses)

    def given_up(self, repair: Repair) -> tuple[Term, ...]:
        """The resources that a repair goes on without."""
        return tuple(substitute_term(term, self.binding) for term in repair.loses)

    def patterns(self, cause: str) -> tuple[Atom, ...]:
        """The facts and events of earlier steps that a cause puts in doubt, as patterns."""
        return self._bound(self.model.causes[cause].spoils)

    def carried_out_by(self, action: FaultTest | Repair) -> Function | None:
        """The step that carries out a test or a repair; None if it is no step, or something in
        it is not known.
        """
        step = substitute_atom(action.by, self.binding) if action.by is not None else None
        return step if step is not None and is_ground(step) else None

    def spoilt(self, cause: str) -> tuple[tuple[StepAchievement, ...], tuple[StepAchievement, ...]]:
        """The steps whose work a cause puts in doubt, and those whose like work stands: what
        was done before `since`.
        """
        entry = self.model.causes[cause]
        patterns, since = self.patterns(cause), self._bound(entry.since)
        last = max(
            (n for n, achieved in enumerate(self.done) if _any_fits(since, achieved.step)),
            default=-1,
        )
        touched = [_matching_part(achieved, patterns) for achieved in self.done]
        return tuple(a for a in touched[last + 1 :] if a), tuple(
            a for a in touched[: last + 1] if a
        )

    def _vain(self, cause: str) -> Iterator[Function]:
        for operator in self.dynamics.problem.domain.operators:
            for effect in operator.effects:
                for pattern in self.patterns(cause):
                    bindings = _unify(effect.atom, pattern) if effect.adds else None
                    if bindings is not None:
                        yield Function(
                            operator.name,
                            tuple(bindings.get(v, ANYTHING) for v in operator.variables),
                        )

    def _step(self, pattern: Function) -> Function:
        """A pattern of steps with the interrupted step's arguments; what it does not bind is
        anything.
        """
        bound_pattern = substitute_atom(pattern, self.binding)
        return substitute_atom(
            bound_pattern, dict.fromkeys(term_variables(bound_pattern), ANYTHING)
        )

    def _fails(self, cause: str, step: Function) -> bool:
        return _any_fits(self.blocked(cause), step) or isinstance(
            self._without_lost(cause).binding(step), str
        )

    def _without_lost(self, cause: str) -> Semantics:
        """What steps mean without the resources that are lost with a cause."""
        lost = frozenset(map(str, self.lost(cause)))
        if lost not in self._limited:
            self._limited[lost] = (
                Semantics(forbid_steps(self.dynamics.problem, lost))
                if lost
                else self.dynamics.semantics
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
        return bind_atoms(atoms, self.binding)


def plan_history(
    dynamics: Dynamics, plan: Plan, done: Sequence[StepId]
) -> tuple[WorldState, tuple[StepAchievement, ...]]:
    """The state after some steps of a plan if each did what it should, and what each of them
    has achieved.
    """
    state, names = dynamics.start(), set(done)
    achieved = []
    for step in plan.steps:
        if step.id in names:
            after, added, moves = dynamics.effects(step.operator, state)
            new = tuple(atom for atom in added if atom not in state.facts)
            achieved.append(StepAchievement(step.id, step.operator, new, moves))
            state = after
    return state, tuple(achieved)


def _unify(effect: Term, pattern: Term) -> dict[Variable, Term] | None:
    """What the variables of an effect must be so that it fits a pattern; None if it cannot."""
    if isinstance(pattern, Variable):
        return {}
    if isinstance(effect, Variable):
        return {effect: pattern}
    if not isinstance(effect, Function) or not isinstance(pattern, Function):
        return {} if effect == pattern else None
    if (effect.name, len(effect.arguments)) != (pattern.name, len(pattern.arguments)):
        return None
    parts = [_unify(a, b) for a, b in zip(effect.arguments, pattern.arguments, strict=True)]
    if any(part is None for part in parts):
        return None
    return {variable: term for part in parts if part for variable, term in part.items()}


def _parts(term: Term) -> Iterator[Term]:
    """A term and all terms in it."""
    yield term
    for argument in term.arguments if isinstance(term, Function) else ():
        yield from _parts(argument)


def _about(term: Term, things: AbstractSet[Term]) -> Term:
    """A term with anything in place of what names none of some things; anything if none of them
    is in it.
    """
    if term in things or not any(part in things for part in _parts(term)):
        return term if term in things else ANYTHING
    assert isinstance(term, Function)
    return Function(term.name, tuple(_about(each, things) for each in term.arguments))


def _any_fits(patterns: Iterable[Function], step: Function) -> bool:
    return any(is_instance(pattern, step) for pattern in patterns)


def _matching_part(work: StepAchievement, patterns: Sequence[Atom]) -> StepAchievement | None:
    """The part of a step's work that fits one of some patterns; None if nothing does."""
    added = tuple(atom for atom in work.added if _any_fits(patterns, atom))
    moved = tuple(move for move in work.moved if _any_fits(patterns, move[2]))
    return replace(work, added=added, moved=moved) if added or moved else None
