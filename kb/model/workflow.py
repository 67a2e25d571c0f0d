"""The meaning of a workflow: when a chain may advance, what reaches a stage, what must hold at the end.

Grounding, MACROPs, revision and the checker share these definitions. They differ in how they follow a plan:
the checker considers every chain that an event can serve, the others take only the first.
"""

from collections.abc import Container, Iterable, Mapping, Sequence

from kb.model.domain import Domain, Kind
from kb.model.problem import Chain
from kb.terms import Atom, is_ground, match

Reached = Mapping[str, int]  # for each chain, how many of its stages are reached


def reaches(atom: Atom, stage: Atom) -> bool:
    """Whether an added atom, or an event, reaches a stage. `_` in a stage stands for anything."""
    return match(stage, atom, {}) is not None


def finished(chains: Iterable[Chain], reached: Reached) -> frozenset[str]:
    """The names of the chains whose stages are all reached."""
    return frozenset(chain.name for chain in chains if reached[chain.name] == len(chain.stages))


def may_advance(chain: Chain, reached: int, done: Container[str]) -> bool:
    """Whether a step may reach the next stage of a chain.

    `reached` is the number of its stages that are reached before the step; `done` are the chains that are
    finished before the step. The chain must have a next stage, and it must have begun already or wait for no
    unfinished chain.

    A step moves a chain by one stage at most.
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
    """What reaches the next stage of each chain that a step moves, and the events that move no chain.

    Each chain moves as soon as possible. An event serves only the first chain that waits for it; an atom
    serves all of them.
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
    """The chains that another chain of the same subject follows. Their last stages need not last."""
    behind: dict[str, frozenset[str]] = {}
    found: set[str] = set()
    subjects = {chain.name: chain.subject for chain in chains}
    for chain in chains:
        behind[chain.name] = frozenset(chain.after).union(*(behind.get(name, ()) for name in chain.after))
        if chain.subject is not None:
            found.update(name for name in behind[chain.name] if subjects.get(name) == chain.subject)
    return frozenset(found)


def lasting(chains: Sequence[Chain], domain: Domain) -> dict[str, Atom]:
    """For each chain, what must still hold at the end: its last stage, if that is a fluent without `_`.

    Chains that another chain of the same subject follows are left out.
    """
    passing = superseded(chains)
    return {
        chain.name: chain.stages[-1]
        for chain in chains
        if chain.name not in passing and is_ground(chain.stages[-1]) and _is_fluent(chain.stages[-1], domain)
    }


def _is_fluent(atom: Atom, domain: Domain) -> bool:
    declared = domain.predicates.get(atom.name)
    return declared is not None and declared.kind is Kind.FLUENT
