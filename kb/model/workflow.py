"""What a workflow means: when a chain may advance, what reaches a stage, what must last. Definitions, and no search.

Grounding, MACROPs, revision and the checker share them. How a plan is followed is each one's own: the checker considers
every reading of an event, the others take the first chain that it serves.
"""

from collections.abc import Container, Iterable, Mapping, Sequence

from kb.model.domain import Domain, Kind
from kb.model.problem import Chain
from kb.terms import Atom, is_ground, match

Reached = Mapping[str, int]  # for each chain, how many of its stages are reached


def reaches(atom: Atom, stage: Atom) -> bool:
    """Whether an atom that is added, or an event that happens, is what a stage names; `_` in a stage stands for anything."""
    return match(stage, atom, {}) is not None


def finished(chains: Iterable[Chain], reached: Reached) -> frozenset[str]:
    """The names of the chains whose stages are all reached."""
    return frozenset(chain.name for chain in chains if reached[chain.name] == len(chain.stages))


def may_advance(chain: Chain, reached: int, done: Container[str]) -> bool:
    """Whether a step may reach the next stage of a chain, `reached` of whose stages are reached and before which the chains
    `done` were finished: it has one more, and has begun or waits for no chain.

    A step moves a chain by one stage at most, and what counts is how things stood before the step.
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


def advanced(
    chains: Sequence[Chain], reached: Reached, events: Sequence[Atom], adds: Iterable[Atom]
) -> tuple[dict[str, Atom], tuple[Atom, ...]]:
    """How a step moves the chains, each as soon as possible: what reaches the next stage of which chain, and the events that
    are the next stage of none. An event serves the first chain that waits for it, an atom all of them.
    """
    left, added = list(events), tuple(adds)
    moved: dict[str, Atom] = {}
    for name, stage in next_stages(chains, reached).items():
        atom = next((each for each in (*left, *added) if reaches(each, stage)), None)
        if atom is not None:
            moved[name] = atom
            if atom in left:
                left.remove(atom)
    return moved, tuple(left)


def superseded(chains: Sequence[Chain]) -> frozenset[str]:
    """The chains after which another one of the same subject comes: what they end with need not last."""
    behind: dict[str, frozenset[str]] = {}
    found: set[str] = set()
    subjects = {chain.name: chain.subject for chain in chains}
    for chain in chains:
        behind[chain.name] = frozenset(chain.after).union(*(behind.get(name, ()) for name in chain.after))
        if chain.subject is not None:
            found.update(name for name in behind[chain.name] if subjects.get(name) == chain.subject)
    return frozenset(found)


def lasting(chains: Sequence[Chain], domain: Domain) -> dict[str, Atom]:
    """What must still hold at the end, by the chain that asks for it: a last stage that is a fluent without `_`, unless a
    later chain of the same subject goes on."""
    passing = superseded(chains)
    return {
        chain.name: chain.stages[-1]
        for chain in chains
        if chain.name not in passing and is_ground(chain.stages[-1]) and _is_fluent(chain.stages[-1], domain)
    }


def _is_fluent(atom: Atom, domain: Domain) -> bool:
    declared = domain.predicates.get(atom.name)
    return declared is not None and declared.kind is Kind.FLUENT
