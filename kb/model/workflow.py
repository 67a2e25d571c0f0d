"""The meaning of a workflow: when a chain may advance, what reaches a stage, what must hold at the end.

A stage that is an event is reached by a step with that event. A stage that is a fluent is reached as soon as the fluent
holds, by whatever step, or from the start on: what holds already costs nothing. A stage of several fluents
(`stored(tube) & capped(tube)`) is reached as soon as all of them hold.

A fluent that nothing makes false, such as a measurement, stays. If a step made it true before its turn, its stage would be
reached later without any step, and the order would be lost. So no step does: such a stage is reached in its turn, or held at
the start.

Grounding, MACROPs, revision and the checker share these definitions. They differ in how they follow a plan:
the checker considers every chain that an event can serve, the others take only the first.
"""

from collections.abc import Callable, Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Protocol

from cellwright.kb.model.domain import Domain, Kind
from cellwright.kb.model.problem import Chain
from cellwright.kb.terms import Atom, is_ground, match, parts_of, together

Reached = Mapping[str, int]  # for each chain, how many of its stages are reached
Holds = Callable[[Atom], bool]  # whether a fluent stage holds in a state; `_` in it stands for anything


def reaches(atom: Atom, stage: Atom) -> bool:
    """Whether an added atom, or an event, reaches a stage. `_` in a stage stands for anything."""
    return match(stage, atom, {}) is not None


def reached_as(stage: Atom, true: Sequence[Atom]) -> Atom:
    """What reached a stage, among events and facts; of a stage of several fluents, all that did, together."""
    found = [next(each for each in true if reaches(each, part)) for part in parts_of(stage)]
    return found[0] if len(found) == 1 else together(found)


def finished(chains: Iterable[Chain], reached: Reached) -> frozenset[str]:
    """The names of the chains whose stages are all reached."""
    return frozenset(chain.name for chain in chains if reached[chain.name] == len(chain.stages))


def may_advance(chain: Chain, reached: int, done: Container[str]) -> bool:
    """Whether a step may reach the next stage of a chain.

    `reached` is the number of its stages that are reached before the step; `done` are the chains that are
    finished before the step. The chain must have a next stage, and it must have begun already or wait for no
    unfinished chain.

    The events of one step move a chain by one stage at most.
    """
    return reached < len(chain.stages) and (reached > 0 or all(name in done for name in chain.after))


def next_stages(chains: Sequence[Chain], reached: Reached) -> dict[str, Atom]:
    """The stage that each chain which may advance waits for, in the order of the chains."""
    done = finished(chains, reached)
    return {
        chain.name: chain.stages[reached[chain.name]]
        for chain in chains
        if may_advance(chain, reached[chain.name], done)
    }


def settled(chains: Sequence[Chain], reached: Reached, holds: Holds) -> dict[str, int]:
    """How far the chains are once every fluent stage that holds, and may be reached, is reached."""
    counts = dict(reached)
    while ready := [name for name, stage in next_stages(chains, counts).items() if holds(stage)]:
        for name in ready:
            counts[name] += 1
    return counts


def begun(chains: Sequence[Chain], holds: Holds) -> dict[str, int]:
    """How far the chains are in the initial state."""
    return settled(chains, {chain.name: 0 for chain in chains}, holds)


def advanced(
    chains: Sequence[Chain], reached: Reached, events: Sequence[Atom], holds: Holds
) -> tuple[dict[str, int], tuple[Atom, ...]]:
    """How far the chains are after a step, and those of its events that move no chain.

    `holds` is about the state after the step. An event serves only the first chain that waited for it before the step.
    """
    counts, left = dict(reached), list(events)
    for name, stage in next_stages(chains, reached).items():
        event = next((each for each in left if reaches(each, stage)), None)
        if event is not None:
            counts[name] += 1
            left.remove(event)
    return settled(chains, counts, holds), tuple(left)


def staying(domain: Domain) -> frozenset[str]:
    """The fluents that nothing in a domain makes false."""
    ended = {effect.atom.name for each in domain.operators for effect in each.effects if not effect.adds}
    ended |= {c.atom.name for each in domain.deductive_operators for c in each.consequences if not c.implied}
    fluents = {name for name, each in domain.predicates.items() if each.kind is Kind.FLUENT}
    return frozenset(fluents - ended - domain.quantities.keys())


def late_stages(chains: Sequence[Chain], domain: Domain) -> tuple[Atom, ...]:
    """The stages of fluents that stay which have to wait for other stages, each once."""
    if not chains:
        return ()
    stays = staying(domain)
    behind = (stage for chain in chains for n, stage in enumerate(chain.stages) if n or chain.after)
    return tuple(s for s in dict.fromkeys(behind) if all(part.name in stays for part in parts_of(s)))


def too_early(late: Sequence[Atom], added: Iterable[Atom], before: Holds, now: Sequence[Atom]) -> Atom | None:
    """The first stage among `late` that a step completes by adding what belongs to no stage whose turn is `now`; else None.

    `before` is about the state before the step.
    """
    for atom in sorted({each for each in added if _is_part(each, late)}, key=str):
        if not before(atom) and not _is_part(atom, now):
            found = next((stage for stage in late if _completes(atom, stage, before)), None)
            if found is not None:
                return found
    return None


def _is_part(atom: Atom, stages: Iterable[Atom]) -> bool:
    return any(reaches(atom, part) for stage in stages for part in parts_of(stage))


def _completes(atom: Atom, stage: Atom, before: Holds) -> bool:
    """Whether a stage holds with an atom, and did not without it."""
    own = [part for part in parts_of(stage) if reaches(atom, part)]
    others = [part for part in parts_of(stage) if part not in own]
    return bool(own) and all(map(before, others)) and not all(map(before, own))


def in_turn(chains: Sequence[Chain], before: Reached, after: Reached) -> list[Atom]:
    """The stages whose turn has come when a step has moved chains from one count to another: reached, or waited for."""
    found = [stage for chain in chains for stage in chain.stages[before[chain.name] : after[chain.name]]]
    return [*found, *next_stages(chains, after).values()]


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


def holding(state: State) -> Holds:
    """Whether a fluent stage holds in a state."""
    return lambda stage: next(those_reaching(stage, state), None) is not None


def those_reaching(stage: Atom, state: State) -> Iterator[Atom]:
    """The atoms of a state that reach a stage; nothing unless every part of the stage holds."""
    found = [list(_those_like(part, state)) for part in parts_of(stage)]
    return (atom for each in found for atom in each) if all(found) else iter(())


def _those_like(atom: Atom, state: State) -> Iterator[Atom]:
    if is_ground(atom):
        return (each for each in (atom,) if each in state)
    return (each for each in state.named(atom.name) if reaches(each, atom))


def superseded(chains: Sequence[Chain]) -> frozenset[str]:
    """The chains that another chain of the same subject follows. Their last stages need not last."""
    behind: dict[str, frozenset[str]] = {}
    found: set[str] = set()
    subjects = {chain.name: chain.subject for chain in chains}
    for chain in chains:
        behind[chain.name] = frozenset(chain.after).union(*(behind.get(name, ()) for name in chain.after))
        if chain.subject is not None:
            found.update(name for name in behind[chain.name] if subjects.get(name) == chain.subject)
    return frozenset(found)


def lasting(chains: Sequence[Chain], domain: Domain) -> dict[str, tuple[Atom, ...]]:
    """For each chain, what must still hold at the end: the fluents of its last stage, if they are without `_`.

    Chains that another chain of the same subject follows, and chains that are not wanted, are left out.
    """
    passing = superseded(chains)
    return {
        chain.name: parts_of(chain.stages[-1])
        for chain in chains
        if chain.wanted
        and chain.name not in passing
        and is_ground(chain.stages[-1])
        and _lasts(chain.stages[-1], domain)
    }


def allowed(chains: Iterable[Chain], domain: Domain) -> Iterator[Chain]:
    """The events of chains as chains that nobody wants to end. They wait for no others."""
    for chain in chains:
        if events := events_of(chain, domain):
            yield replace(chain, stages=events, after=(), wanted=False)


def events_of(chain: Chain, domain: Domain) -> tuple[Atom, ...]:
    """The stages of a chain that are events."""
    declared = [(stage, domain.predicates.get(stage.name)) for stage in chain.stages]
    return tuple(stage for stage, each in declared if each is not None and each.kind is Kind.EVENT)


def _lasts(stage: Atom, domain: Domain) -> bool:
    declared = [domain.predicates.get(atom.name) for atom in parts_of(stage)]
    return all(each is not None and each.kind is Kind.FLUENT for each in declared)
