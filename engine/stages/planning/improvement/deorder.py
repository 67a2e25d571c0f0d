"""From a sequence of steps to a partial order that has only what a causal link, a threat or a resource needs.

This is explanation-based order generalisation (Kambhampati & Kedar 1994). Each condition is linked to the
earliest step from which on it stays true. Links and the threats to them require orders. Two steps that must
not run at the same time need an order, too, because unordered steps may overlap in time.
"""

from collections.abc import Iterator, Sequence

from engine.model.task import Bits, GroundOperator, Task, indices
from kb.model.plan import GOAL, START, CausalLink, Plan, Step, StepId
from kb.terms import Function, Term


def deorder(task: Task, steps: Sequence[GroundOperator], goals: Bits) -> Plan:
    """The partially ordered plan of an executable sequence of unconditional operators that ends in `goals`.

    Internal operators are left out; they come last and only note which goals are met. What they need becomes
    a goal.
    """
    made = [operator for operator in steps if not is_internal(operator.instance)]
    links = [
        (producer, atom, min(consumer, len(made)))
        for producer, atom, consumer in _links(task, steps, goals)
        if producer < len(made) and not is_internal(task.atoms[atom])
    ]
    links = list(dict.fromkeys(links))
    return _ordered(task, made, links, _orders(made, links, _exclusions(made)))


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


def _links(task: Task, steps: Sequence[GroundOperator], goals: Bits) -> list[tuple[int, int, int]]:
    """The causal links as (producer, atom, consumer), by position.

    Position -1 is the initial state, len(steps) is the goal. The producer is the earliest position from which
    on the atom stays true up to the consumer.
    """
    links: list[tuple[int, int, int]] = []
    producers = dict.fromkeys(indices(task.initial), -1)
    for position, operator in enumerate(steps):
        links += [(producers[atom], atom, position) for atom in indices(operator.preconditions)]
        for atom in indices(operator.deletes & ~operator.adds):
            producers.pop(atom, None)
        for atom in indices(operator.adds):
            producers.setdefault(atom, position)
    return links + [(producers[atom], atom, len(steps)) for atom in indices(goals)]


def arranged(task: Task, steps: Sequence[GroundOperator], goals: Bits) -> list[GroundOperator]:
    """The same steps, each put directly after the steps that it depends on, where this is possible."""
    before = _orders(steps, _links(task, steps, goals), [0] * len(steps))
    order: list[int] = []
    placed = 0
    for last in range(len(steps)):
        waiting = [last]
        while waiting:
            missing = before[waiting[-1]] & ~placed
            if missing:
                waiting.append(missing.bit_length() - 1)
                continue
            step = waiting.pop()
            if not placed >> step & 1:
                placed |= 1 << step
                order.append(step)
    return [steps[position] for position in order]


def _orders(
    steps: Sequence[GroundOperator], links: list[tuple[int, int, int]], before: list[Bits]
) -> list[Bits]:
    """For each step the positions of the steps that must come before it.

    These are the positions already in `before`, and those that links and threats require.
    """
    deleters = _positions([operator.deletes & ~operator.adds for operator in steps])
    for producer, atom, consumer in links:
        threats = deleters.get(atom, 0)
        if 0 <= producer < consumer < len(steps):
            before[consumer] |= 1 << producer
        if producer >= 0:
            before[producer] |= threats & (1 << producer) - 1
        for threat in indices(threats & -1 << consumer + 1):
            before[threat] |= 1 << consumer
    return before


def _positions(sets: Sequence[Bits]) -> dict[int, Bits]:
    """For each atom the positions of the sets that contain it."""
    found: dict[int, Bits] = {}
    for position, atoms in enumerate(sets):
        for atom in indices(atoms):
            found[atom] = found.get(atom, 0) | 1 << position
    return found


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
