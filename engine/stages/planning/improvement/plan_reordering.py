"""Orders of a plan: the partial order it needs, dear steps late, or equal steps side by side.

This is explanation-based order generalisation (Kambhampati & Kedar 1994). Each condition is linked
to the earliest step from which on it stays true. Links and the threats to them require orders. Two
steps that must not run at the same time need an order, too, because unordered steps may overlap in
time.
"""

from collections import Counter
from collections.abc import Iterator, Sequence
from heapq import heapify, heappop, heappush
from random import Random

from cellwright.engine.kernels.bits import Bits, indices
from cellwright.engine.model.ground_task import GroundOperator, GroundTask
from cellwright.engine.model.workflow_replay import join_stages
from cellwright.engine.stages.planning.effect_variants import plain_steps
from cellwright.kb.model.plan_model import GOAL_STEP, INITIAL_STEP, CausalLink, Plan, Step, StepId
from cellwright.kb.terms import Function, Term


def deorder_steps(
    task: GroundTask,
    steps: Sequence[GroundOperator],
    goals: Bits,
    starts: Sequence[int] | None = None,
) -> Plan:
    """The partially ordered plan of an executable sequence of unconditional operators that ends in
    `goals`.

    Internal operators that reach stages become parts of steps. Those that come last and only note
    which goals are met are left out: what they need is a goal. With `starts`, which say when each
    step starts, no step waits for one that has not ended by then; there are no internal operators
    among the steps then.
    """
    steps, goals = join_stages(task, steps, goals)
    real_steps = [operator for operator in steps if not is_internal(operator.instance)]
    links = [
        (producer, atom, min(consumer, len(real_steps)))
        for producer, atom, consumer in _causal_links(task, steps, goals, starts)
        if producer < len(real_steps) and not is_internal(task.atoms[atom])
    ]
    links = list(dict.fromkeys(links))
    before = _excluded_steps(real_steps)  # which also keep steps that would end a link away from it
    for producer, _, consumer in links:
        if 0 <= producer < consumer < len(real_steps):
            before[consumer] |= 1 << producer
    return _ordered_plan(task, real_steps, links, before)


def is_internal(name: Function) -> bool:
    """Whether grounding made an atom or operator that means nothing in the domain.

    Workflow stages are not internal.
    """
    return name.name.startswith("_") and name.name != "_stage"


def _ordered_plan(
    task: GroundTask,
    steps: Sequence[GroundOperator],
    links: list[tuple[int, int, int]],
    before: list[Bits],
) -> Plan:
    plan_steps = tuple(
        Step(
            StepId(number + 1),
            operator.instance,
            tuple(StepId(position + 1) for position in indices(direct)),
            operator.resources,
            operator.duration,
            operator.cost,
        )
        for number, (operator, direct) in enumerate(
            zip(steps, _transitive_reduction(before), strict=True)
        )
    )
    return Plan(plan_steps, tuple(_causal_link(task, len(steps), *link) for link in links))


def _transitive_reduction(before: list[Bits]) -> Iterator[Bits]:
    """For each step the steps that must come directly before it: the transitive reduction of
    `before`.
    """
    ancestors: list[Bits] = []
    for earlier in before:
        remaining, direct, covered = earlier, 0, 0
        while remaining:
            last = remaining.bit_length() - 1
            direct |= 1 << last
            covered |= ancestors[last] | 1 << last
            remaining &= ~covered
        ancestors.append(covered)
        yield direct


def _causal_links(
    task: GroundTask,
    steps: Sequence[GroundOperator],
    goals: Bits,
    starts: Sequence[int] | None = None,
) -> list[tuple[int, int, int]]:
    """(producer, atom, consumer) by position; -1 is the initial state, len(steps) the goal.

    The producer is the earliest position from which the atom stays true up to the consumer, and
    which has ended by then.
    """
    links: list[tuple[int, int, int]] = []
    producers = {atom: [-1] for atom in indices(task.initial)}

    def producer(atom: int, consumer: int) -> int:
        if starts is None:
            return producers[atom][0]
        ended = (
            p for p in producers[atom] if p < 0 or starts[p] + steps[p].duration <= starts[consumer]
        )
        return next(ended, producers[atom][0])

    for position, operator in enumerate(steps):
        links += [
            (producer(atom, position), atom, position) for atom in indices(operator.preconditions)
        ]
        for atom in indices(operator.deletes & ~operator.adds):
            producers.pop(atom, None)
        for atom in indices(operator.adds):
            producers.setdefault(atom, []).append(position)
    return links + [(producers[atom][0], atom, len(steps)) for atom in indices(goals)]


def _excluded_steps(steps: Sequence[GroundOperator]) -> list[Bits]:
    """For each step the earlier steps that it must not overlap.

    Two steps must not overlap if they hold the same resource, or if one denies what the other adds
    or needs.
    """
    touching: dict[int, Bits] = {}
    denying: dict[int, Bits] = {}
    holding: dict[Term, Bits] = {}
    before = []
    for position, operator in enumerate(steps):
        bit, excluded = 1 << position, 0
        denied, touched = operator.deletes & ~operator.adds, operator.adds | operator.preconditions
        for seen, earlier_users, atoms in (
            (denying, touching, denied),
            (touching, denying, touched),
        ):
            for atom in indices(atoms):
                excluded |= earlier_users.get(atom, 0)
                seen[atom] = seen.get(atom, 0) | bit
        for resource in operator.resources:
            excluded |= holding.get(resource, 0)
            holding[resource] = holding.get(resource, 0) | bit
        before.append(excluded & ~bit)
    return before


def _causal_link(
    task: GroundTask, last: int, producer: int, atom: int, consumer: int
) -> CausalLink:
    user = GOAL_STEP if consumer == last else StepId(consumer + 1)
    return CausalLink(
        INITIAL_STEP if producer < 0 else StepId(producer + 1), task.atoms[atom], user
    )


def delay_dear_steps(task: GroundTask, steps: Sequence[GroundOperator]) -> list[GroundOperator]:
    """The same steps in an order with the same effect: cheap steps that are done once come as early
    as they can.

    Then nothing that can be done before a batch stands between two batches.
    """
    done = Counter(step.instance for step in steps)
    rank = [(done[step.instance] > 1, step.cost, place) for place, step in enumerate(steps)]
    before = [indices(mask) for mask in _fixed_predecessors(plain_steps(task, steps))]
    after: list[list[int]] = [[] for _ in steps]
    for place, earlier in enumerate(before):
        for predecessor in earlier:
            after[predecessor].append(place)
    missing = [len(predecessors) for predecessors in before]
    ready = [rank[place] for place in range(len(steps)) if not missing[place]]
    heapify(ready)
    order = []
    while ready:
        place = heappop(ready)[-1]
        order.append(steps[place])
        for successor in after[place]:
            missing[successor] -= 1
            if not missing[successor]:
                heappush(ready, rank[successor])
    return order


def group_steps(steps: Sequence[GroundOperator], chance: Random) -> list[GroundOperator]:
    """The same unconditional steps in an order with the same effect: before a step comes what it
    needs, if that is not done yet.

    So the steps of one errand stand side by side, which the plan may have mixed with others. Chance
    decides which errand is first.
    """
    before = [indices(mask) for mask in _fixed_predecessors(steps)]
    needed = {place for own in before for place in own}
    last = [place for place in range(len(steps)) if place not in needed]
    order, seen = list[int](), set[int]()
    waiting = [(place, False) for place in chance.sample(last, len(last))]
    while waiting:
        place, ready = waiting.pop()
        if ready:
            order.append(place)
        elif place not in seen:
            seen.add(place)
            waiting += [(place, True), *((earlier, False) for earlier in before[place])]
    return [steps[place] for place in order]


def _fixed_predecessors(steps: Sequence[GroundOperator]) -> list[Bits]:
    """For each unconditional step the earlier ones with which it must not change places."""
    adding: dict[int, Bits] = {}
    denying: dict[int, Bits] = {}
    touching: dict[int, Bits] = {}
    masks = []
    for place, step in enumerate(steps):
        denied, touched, earlier = step.deletes & ~step.adds, step.adds | step.preconditions, 0
        for seen, atoms in ((touching, denied), (denying, touched), (adding, step.preconditions)):
            for atom in indices(atoms):
                earlier |= seen.get(atom, 0)
        for seen, atoms in ((touching, touched), (denying, denied), (adding, step.adds)):
            for atom in indices(atoms):
                seen[atom] = seen.get(atom, 0) | 1 << place
        masks.append(earlier)
    return masks
