"""From a sequence of steps to a partial order that has only what a causal link, a threat or a resource needs.

This is explanation-based order generalisation (Kambhampati & Kedar 1994). Each condition is linked to the
earliest step from which on it stays true. Links and the threats to them require orders. Two steps that must
not run at the same time need an order, too, because unordered steps may overlap in time.
"""

from collections.abc import Iterator, Sequence

from cellwright.engine.model.replay import joined
from cellwright.engine.model.task import Bits, GroundOperator, Task, indices
from cellwright.kb.model.plan import GOAL, START, CausalLink, Plan, Step, StepId
from cellwright.kb.terms import Function, Term


def deorder(
    task: Task, steps: Sequence[GroundOperator], goals: Bits, starts: Sequence[int] | None = None
) -> Plan:
    """The partially ordered plan of an executable sequence of unconditional operators that ends in `goals`.

    Internal operators that reach stages become parts of steps. Those that come last and only note which goals are met
    are left out: what they need is a goal. With `starts`, which say when each step starts, no step waits for one that has
    not ended by then; there are no internal operators among the steps then.
    """
    steps, goals = joined(task, steps, goals)
    made = [operator for operator in steps if not is_internal(operator.instance)]
    links = [
        (producer, atom, min(consumer, len(made)))
        for producer, atom, consumer in _links(task, steps, goals, starts)
        if producer < len(made) and not is_internal(task.atoms[atom])
    ]
    links = list(dict.fromkeys(links))
    before = _exclusions(made)  # which also keep steps that would end a link away from it
    for producer, _, consumer in links:
        if 0 <= producer < consumer < len(made):
            before[consumer] |= 1 << producer
    return _ordered(task, made, links, before)


def is_internal(name: Function) -> bool:
    """Whether grounding made an atom or operator that means nothing in the domain.

    Workflow stages are not internal.
    """
    return name.name.startswith("_") and name.name != "_stage"


def _ordered(
    task: Task, steps: Sequence[GroundOperator], links: list[tuple[int, int, int]], before: list[Bits]
) -> Plan:
    made = tuple(
        Step(
            StepId(number + 1),
            operator.instance,
            tuple(StepId(each + 1) for each in indices(direct)),
            operator.resources,
            operator.duration,
            operator.cost,
        )
        for number, (operator, direct) in enumerate(zip(steps, _reduced(before), strict=True))
    )
    return Plan(made, tuple(_causal_link(task, len(steps), *link) for link in links))


def _reduced(before: list[Bits]) -> Iterator[Bits]:
    """For each step the steps that must come directly before it: the transitive reduction of `before`."""
    ancestors: list[Bits] = []
    for earlier in before:
        left, direct, covered = earlier, 0, 0
        while left:
            last = left.bit_length() - 1
            direct |= 1 << last
            covered |= ancestors[last] | 1 << last
            left &= ~covered
        ancestors.append(covered)
        yield direct


def _links(
    task: Task, steps: Sequence[GroundOperator], goals: Bits, starts: Sequence[int] | None = None
) -> list[tuple[int, int, int]]:
    """(producer, atom, consumer) by position; -1 is the initial state, len(steps) the goal.

    The producer is the earliest position from which the atom stays true up to the consumer, and which has ended by then.
    """
    links: list[tuple[int, int, int]] = []
    producers = {atom: [-1] for atom in indices(task.initial)}

    def producer(atom: int, consumer: int) -> int:
        if starts is None:
            return producers[atom][0]
        ended = (p for p in producers[atom] if p < 0 or starts[p] + steps[p].duration <= starts[consumer])
        return next(ended, producers[atom][0])

    for position, operator in enumerate(steps):
        links += [(producer(atom, position), atom, position) for atom in indices(operator.preconditions)]
        for atom in indices(operator.deletes & ~operator.adds):
            producers.pop(atom, None)
        for atom in indices(operator.adds):
            producers.setdefault(atom, []).append(position)
    return links + [(producers[atom][0], atom, len(steps)) for atom in indices(goals)]


def _exclusions(steps: Sequence[GroundOperator]) -> list[Bits]:
    """For each step the earlier steps that it must not overlap.

    Two steps must not overlap if they hold the same resource, or if one denies what the other adds or needs.
    """
    touching: dict[int, Bits] = {}
    denying: dict[int, Bits] = {}
    holding: dict[Term, Bits] = {}
    before = []
    for position, operator in enumerate(steps):
        bit, excluded = 1 << position, 0
        denied, touched = operator.deletes & ~operator.adds, operator.adds | operator.preconditions
        for seen, other, atoms in ((denying, touching, denied), (touching, denying, touched)):
            for atom in indices(atoms):
                excluded |= other.get(atom, 0)
                seen[atom] = seen.get(atom, 0) | bit
        for resource in operator.resources:
            excluded |= holding.get(resource, 0)
            holding[resource] = holding.get(resource, 0) | bit
        before.append(excluded & ~bit)
    return before


def _causal_link(task: Task, last: int, producer: int, atom: int, consumer: int) -> CausalLink:
    user = GOAL if consumer == last else StepId(consumer + 1)
    return CausalLink(START if producer < 0 else StepId(producer + 1), task.atoms[atom], user)
