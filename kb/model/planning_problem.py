"""The problem: what one task adds to its domain; and how its workflow advances."""

import dataclasses
from collections.abc import Callable, Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol

from cellwright.kb.diagnostics import NOWHERE, Source
from cellwright.kb.model.conditions import ALWAYS_TRUE, Condition
from cellwright.kb.model.domain_model import Domain, Kind
from cellwright.kb.model.time_windows import TimeOfWork, TimeWindow
from cellwright.kb.terms import Atom, Function, Term, is_ground, join_stage, match_term, stage_parts


@dataclass(frozen=True, slots=True)
class Chain:
    """The ordered stages of one object (or of one group of bindings).

    `after` names chains that must be finished first. The last stage must still hold at the end,
    unless a chain of the same subject comes after this one. Any atom that fits reaches a fluent
    stage with `_`. Such a stage need not last, unless a goal says so. A stage of several fluents
    that are reached together is one term, `&` of them (`cellwright.kb.terms.join_stage`). A chain
    that is not `wanted` says which events may occur, in their order; none of them has to.
    """

    name: str
    stages: tuple[Atom, ...]
    after: tuple[str, ...] = ()
    subject: Term | None = None
    where: Source = field(default=NOWHERE, compare=False)
    wanted: bool = True

    def wait_only_for(self, names: Container[str]) -> "Chain":
        """The same chain, which waits no more for chains that are not among `names`."""
        return replace(self, after=tuple(name for name in self.after if name in names))


@dataclass(frozen=True, slots=True)
class Problem:
    """Objects, statics, initial facts, goals and workflow of one task.

    `path` is empty for a problem that is not from a file. `durations` says how long some steps
    last, in the domain's unit of time, in place of what their operators say.
    """

    name: str
    domain: Domain
    objects: Mapping[str, str] = field(default_factory=dict)
    statics: tuple[Atom, ...] = ()
    initial: tuple[Atom, ...] = ()
    goal: Condition = ALWAYS_TRUE
    chains: tuple[Chain, ...] = ()
    complete: bool = (
        False  # `initial` is a complete state: no deductive operators or defaults are applied to it
    )
    path: str = ""
    where: Source = field(default=NOWHERE, compare=False)
    durations: Mapping[Function, int] = field(default_factory=dict)
    windows: tuple[TimeWindow, ...] = ()
    calendars: tuple[TimeOfWork, ...] = ()

    @property
    def all_windows(self) -> tuple[TimeWindow, ...]:
        """The windows of the domain and of the problem, each once."""
        return tuple(dict.fromkeys((*self.domain.windows, *self.windows)))

    @property
    def all_calendars(self) -> tuple[TimeOfWork, ...]:
        """The calendars of the domain and of the problem."""
        return (*self.domain.calendars, *self.calendars)

    def replace(self, initial: tuple[Atom, ...]) -> "Problem":
        """The same problem from an observed state, which is taken as complete."""
        return dataclasses.replace(self, initial=initial, complete=True)


Reached = Mapping[str, int]  # for each chain, how many of its stages are reached
# whether a fluent stage holds in a state; `_` in it stands for anything
Holds = Callable[[Atom], bool]


def reaches_stage(atom: Atom, stage: Atom) -> bool:
    """Whether an added atom, or an event, reaches a stage. `_` in a stage stands for anything."""
    return match_term(stage, atom, {}) is not None


def reached_as(stage: Atom, true: Sequence[Atom]) -> Atom:
    """What reached a stage, among events and facts; of a stage of several fluents, all that
    did, together.
    """
    reaching_atoms = [
        next(atom for atom in true if reaches_stage(atom, part)) for part in stage_parts(stage)
    ]
    return reaching_atoms[0] if len(reaching_atoms) == 1 else join_stage(reaching_atoms)


def finished_chains(chains: Iterable[Chain], reached: Reached) -> frozenset[str]:
    """The names of the chains whose stages are all reached."""
    return frozenset(chain.name for chain in chains if reached[chain.name] == len(chain.stages))


def may_advance(chain: Chain, reached: int, done: Container[str]) -> bool:
    """Whether a step may reach the next stage of a chain.

    `reached` is the number of its stages that are reached before the step; `done` are the chains
    that are finished before the step. The chain must have a next stage, and it must have begun
    already or wait for no unfinished chain.

    The events of one step move a chain by one stage at most.
    """
    return reached < len(chain.stages) and (
        reached > 0 or all(name in done for name in chain.after)
    )


def next_stages(chains: Sequence[Chain], reached: Reached) -> dict[str, Atom]:
    """The stage that each chain which may advance waits for, in the order of the chains."""
    done = finished_chains(chains, reached)
    return {
        chain.name: chain.stages[reached[chain.name]]
        for chain in chains
        if may_advance(chain, reached[chain.name], done)
    }


def settle_chains(chains: Sequence[Chain], reached: Reached, holds: Holds) -> dict[str, int]:
    """How far the chains are once every fluent stage that holds, and may be reached, is reached."""
    counts = dict(reached)
    while ready := [name for name, stage in next_stages(chains, counts).items() if holds(stage)]:
        for name in ready:
            counts[name] += 1
    return counts


def initial_progress(chains: Sequence[Chain], holds: Holds) -> dict[str, int]:
    """How far the chains are in the initial state."""
    return settle_chains(chains, {chain.name: 0 for chain in chains}, holds)


def advance_chains(
    chains: Sequence[Chain], reached: Reached, events: Sequence[Atom], holds: Holds
) -> tuple[dict[str, int], tuple[Atom, ...]]:
    """How far the chains are after a step, and those of its events that move no chain.

    `holds` is about the state after the step. An event serves only the first chain that waited for
    it before the step.
    """
    counts, left = dict(reached), list(events)
    for name, stage in next_stages(chains, reached).items():
        event = next((event_atom for event_atom in left if reaches_stage(event_atom, stage)), None)
        if event is not None:
            counts[name] += 1
            left.remove(event)
    return settle_chains(chains, counts, holds), tuple(left)


def lasting_fluents(domain: Domain) -> frozenset[str]:
    """The fluents that nothing in a domain makes false."""
    ended = {
        effect.atom.name
        for operator in domain.operators
        for effect in operator.effects
        if not effect.adds
    }
    ended |= {
        c.atom.name
        for deductive in domain.deductive_operators
        for c in deductive.consequences
        if not c.implied
    }
    fluents = {
        name for name, predicate in domain.predicates.items() if predicate.kind is Kind.FLUENT
    }
    return frozenset(fluents - ended - domain.quantities.keys())


def late_stages(chains: Sequence[Chain], domain: Domain) -> tuple[Atom, ...]:
    """The stages of fluents that stay which have to wait for other stages, each once."""
    if not chains:
        return ()
    stays = lasting_fluents(domain)
    behind = (stage for chain in chains for n, stage in enumerate(chain.stages) if n or chain.after)
    return tuple(
        s for s in dict.fromkeys(behind) if all(part.name in stays for part in stage_parts(s))
    )


def too_early(
    late: Sequence[Atom], added: Iterable[Atom], before: Holds, now: Sequence[Atom]
) -> Atom | None:
    """The first stage among `late` that a step completes by adding what belongs to no stage whose
    turn is `now`; else None.

    `before` is about the state before the step.
    """
    for atom in sorted({added_atom for added_atom in added if _is_part(added_atom, late)}, key=str):
        if not before(atom) and not _is_part(atom, now):
            late_stage = next(
                (stage for stage in late if _completes_stage(atom, stage, before)), None
            )
            if late_stage is not None:
                return late_stage
    return None


def _is_part(atom: Atom, stages: Iterable[Atom]) -> bool:
    return any(reaches_stage(atom, part) for stage in stages for part in stage_parts(stage))


def _completes_stage(atom: Atom, stage: Atom, before: Holds) -> bool:
    """Whether a stage holds with an atom, and did not without it."""
    own = [part for part in stage_parts(stage) if reaches_stage(atom, part)]
    others = [part for part in stage_parts(stage) if part not in own]
    return bool(own) and all(map(before, others)) and not all(map(before, own))


def stages_in_turn(chains: Sequence[Chain], before: Reached, after: Reached) -> list[Atom]:
    """The stages whose turn has come when a step has moved chains from one count to another:
    reached, or waited for.
    """
    moved_stages = [
        stage for chain in chains for stage in chain.stages[before[chain.name] : after[chain.name]]
    ]
    return [*moved_stages, *next_stages(chains, after).values()]


class State(Protocol):
    """Ground atoms, by predicate."""

    def __contains__(self, atom: Atom, /) -> bool:
        """Whether an atom is true."""

    def named(self, name: str, /) -> Iterable[Atom]:
        """Every true atom of a predicate."""


class Listed(frozenset[Atom]):
    """A state of a few atoms."""

    def named(self, name: str) -> Iterator[Atom]:
        """Every atom of a predicate, in the order of their text."""
        return (atom for atom in sorted(self, key=str) if atom.name == name)


def stage_holds(state: State) -> Holds:
    """Whether a fluent stage holds in a state."""
    return lambda stage: next(those_reaching(stage, state), None) is not None


def those_reaching(stage: Atom, state: State) -> Iterator[Atom]:
    """The atoms of a state that reach a stage; nothing unless every part of the stage holds."""
    reaching_atoms = [list(_those_like(part, state)) for part in stage_parts(stage)]
    return (
        (atom for part_atoms in reaching_atoms for atom in part_atoms)
        if all(reaching_atoms)
        else iter(())
    )


def _those_like(atom: Atom, state: State) -> Iterator[Atom]:
    if is_ground(atom):
        return (true_atom for true_atom in (atom,) if true_atom in state)
    return (true_atom for true_atom in state.named(atom.name) if reaches_stage(true_atom, atom))


def superseded_chains(chains: Sequence[Chain]) -> frozenset[str]:
    """The chains that another chain of the same subject follows.

    Their last stages need not last.
    """
    behind: dict[str, frozenset[str]] = {}
    followed: set[str] = set()
    subjects = {chain.name: chain.subject for chain in chains}
    for chain in chains:
        behind[chain.name] = frozenset(chain.after).union(
            *(behind.get(name, ()) for name in chain.after)
        )
        if chain.subject is not None:
            followed.update(
                name for name in behind[chain.name] if subjects.get(name) == chain.subject
            )
    return frozenset(followed)


def final_stages(chains: Sequence[Chain], domain: Domain) -> dict[str, tuple[Atom, ...]]:
    """For each chain, what must still hold at the end: the fluents of its last stage, if they are
    without `_`.

    Chains that another chain of the same subject follows, and chains that are not wanted, are left
    out.
    """
    passing = superseded_chains(chains)
    return {
        chain.name: stage_parts(chain.stages[-1])
        for chain in chains
        if chain.wanted
        and chain.name not in passing
        and is_ground(chain.stages[-1])
        and _stage_lasts(chain.stages[-1], domain)
    }


def event_chains(chains: Iterable[Chain], domain: Domain) -> Iterator[Chain]:
    """The events of chains as chains that nobody wants to end. They wait for no others."""
    for chain in chains:
        if events := events_of(chain, domain):
            yield replace(chain, stages=events, after=(), wanted=False)


def events_of(chain: Chain, domain: Domain) -> tuple[Atom, ...]:
    """The stages of a chain that are events."""
    declared = [(stage, domain.predicates.get(stage.name)) for stage in chain.stages]
    return tuple(
        stage
        for stage, predicate in declared
        if predicate is not None and predicate.kind is Kind.EVENT
    )


def _stage_lasts(stage: Atom, domain: Domain) -> bool:
    declared = [domain.predicates.get(atom.name) for atom in stage_parts(stage)]
    return all(predicate is not None and predicate.kind is Kind.FLUENT for predicate in declared)
