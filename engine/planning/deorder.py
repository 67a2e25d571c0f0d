"""From a sequence of steps to a partial order: keep only orders that a causal link, a threat or a resource needs.

Explanation-based order generalisation (Kambhampati & Kedar 1994): each condition is linked to the earliest step that
provides it for good; orders follow from the links, from the threats to them, and from what two steps may not do at
once, since unordered steps may overlap in time.
"""

from collections.abc import Sequence

import networkx as nx

from engine.model.task import Bits, GroundOperator, Task, indices
from kb.model.plan import GOAL, START, CausalLink, Plan, Step, StepId
from kb.terms import Function


def deorder(task: Task, steps: Sequence[GroundOperator], goals: Bits) -> Plan:
    """The partially ordered plan of an executable sequence of unconditional operators that ends in `goals`.

    Internal operators, which come last and only note which goals are met, are left out: what they need is a goal.
    """
    made = [operator for operator in steps if not is_internal(operator.instance)]
    links = [
        (producer, atom, min(consumer, len(made)))
        for producer, atom, consumer in _links(task, steps, goals)
        if producer < len(made) and not is_internal(task.atoms[atom])
    ]
    links = list(dict.fromkeys(links))
    return _ordered(task, made, links, _orders(made, links))


def is_internal(name: Function) -> bool:
    """Whether an atom or operator was made by grounding and means nothing to the domain; stages do."""
    return name.name.startswith("_") and name.name != "_stage"


def _ordered(
    task: Task,
    steps: Sequence[GroundOperator],
    links: list[tuple[int, int, int]],
    orders: set[tuple[int, int]],
) -> Plan:
    order: nx.DiGraph[int] = nx.DiGraph()
    order.add_nodes_from(range(len(steps)))
    order.add_edges_from(orders)
    reduced = nx.transitive_reduction(order) if len(steps) < 2000 else order
    made = tuple(
        Step(
            StepId(number + 1),
            operator.instance,
            tuple(StepId(before + 1) for before in sorted(reduced.predecessors(number))),
            operator.resources,
            operator.duration,
            operator.cost,
        )
        for number, operator in enumerate(steps)
    )
    return Plan(made, tuple(_causal_link(task, len(steps), *link) for link in links))


def _links(task: Task, steps: Sequence[GroundOperator], goals: Bits) -> list[tuple[int, int, int]]:
    """(producer, atom, consumer) by position; -1 is the initial state, len(steps) the goal."""
    links: list[tuple[int, int, int]] = []
    needs = [operator.preconditions for operator in steps] + [goals]
    for consumer, needed in enumerate(needs):
        links += [
            (_producer(task.initial, steps, atom, consumer), atom, consumer) for atom in indices(needed)
        ]
    return links


def _producer(initial: Bits, steps: Sequence[GroundOperator], atom: int, consumer: int) -> int:
    """The earliest position from which `atom` stays true up to `consumer`."""
    bit, found = 1 << atom, consumer
    for position in range(consumer - 1, -1, -1):
        if steps[position].adds & bit:
            found = position
        elif steps[position].deletes & bit:
            return found
    return -1 if initial & bit else found


def _orders(steps: Sequence[GroundOperator], links: list[tuple[int, int, int]]) -> set[tuple[int, int]]:
    orders = {
        (producer, consumer) for producer, _, consumer in links if producer >= 0 and consumer < len(steps)
    }
    deleters: dict[int, list[int]] = {}
    for position, operator in enumerate(steps):
        for atom in indices(operator.deletes & ~operator.adds):
            deleters.setdefault(atom, []).append(position)
    for producer, atom, consumer in links:
        for threat in deleters.get(atom, ()):
            if threat < producer:
                orders.add((threat, producer))
            elif threat > consumer:
                orders.add((consumer, threat))
    return orders | _exclusions(steps)


def _exclusions(steps: Sequence[GroundOperator]) -> set[tuple[int, int]]:
    """Pairs that may not overlap, in the order they had: a shared resource, or one denies what the other adds or needs."""
    orders = set()
    held = [frozenset(operator.resources) for operator in steps]
    for later, operator in enumerate(steps):
        touched = operator.adds | operator.preconditions
        for earlier in range(later):
            other = steps[earlier]
            if (
                held[later] & held[earlier]
                or other.deletes & ~other.adds & touched
                or operator.deletes & ~operator.adds & (other.adds | other.preconditions)
            ):
                orders.add((earlier, later))
    return orders


def _causal_link(task: Task, last: int, producer: int, atom: int, consumer: int) -> CausalLink:
    user = GOAL if consumer == last else StepId(consumer + 1)
    return CausalLink(START if producer < 0 else StepId(producer + 1), task.atoms[atom], user)
