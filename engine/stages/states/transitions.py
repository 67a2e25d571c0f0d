"""Transitions of the class-level net: steps between forms that lead from the same places to the same places."""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence

from cellwright.engine.model.task_space import Edge, Place, Space, Step, Transfer, Transition
from cellwright.engine.stages.states.clusters import Named, neighbours
from cellwright.engine.stages.states.outlines import Outline, needed
from cellwright.engine.stages.states.places import Sorted, normal
from cellwright.kb.model.contacts import Restriction, describes
from cellwright.kb.model.octuples import ANY, Octuple, Quadruple

Group = tuple[bool, str, tuple[tuple[int, int], tuple[int, int]], tuple[int, ...], tuple[int, ...]]


def transitions(space: Space, found: Sorted, used: Iterable[Step]) -> tuple[Transition, ...]:
    """The transitions of the steps that can be taken, named after their operators, in the order of their places."""
    groups: dict[Group, list[Step]] = {}
    for step in sorted(used):
        groups.setdefault(_group(found, step), []).append(step)
    ordered = sorted(groups, key=lambda each: (each[3], each[4], not each[0], each[1:3]))
    names = _names(space, found, {group: groups[group] for group in ordered})
    able: Able = {}
    for steps in groups.values():
        for step in steps:
            able.setdefault((*_group(found, step)[:3], _place(found, step)), set()).add(_with_contact(step))
    return tuple(
        _transition(space, found, group, groups[group], names[group], groups, able) for group in ordered
    )


Able = dict[tuple[bool, str, tuple[tuple[int, int], tuple[int, int]], int], set[int]]


def _with_contact(step: Step) -> int:
    """The form in which the contact of a step holds."""
    return (step.outputs if step.makes else step.inputs)[0]


def _place(found: Sorted, step: Step) -> int:
    return found.place_of[_with_contact(step)]


def _group(found: Sorted, step: Step) -> Group:
    inputs = tuple(sorted(found.place_of[form] for form in step.inputs))
    outputs = tuple(sorted(found.place_of[form] for form in step.outputs))
    return step.makes, step.kind, step.ends, inputs, outputs


def _transition(
    space: Space,
    found: Sorted,
    group: Group,
    steps: Sequence[Step],
    name: str,
    groups: Mapping[Group, object],
    able: Able,
) -> Transition:
    makes, kind, ends, inputs, outputs = group
    contact_class = space.model.contact_classes[kind]
    joint = _place(found, steps[0])
    whole = able[makes, kind, ends, joint] == set(found.places[joint].forms)
    return Transition(
        name,
        f"{contact_class.make if makes else contact_class.unmake} {' - '.join(_ends(space, ends))}",
        contact_class.make if makes else contact_class.unmake,
        makes,
        contact_of(space, ends),
        tuple(found.places[each].name for each in inputs),
        tuple(found.places[each].name for each in outputs),
        tuple(_transfers(space, found, steps)),
        tuple(_restrictions(space, ends, kind, found.places[joint])),
        (not makes, kind, ends, outputs, inputs) in groups,
        tuple(dict.fromkeys(_cases(space, found, group, steps, whole))),
        tuple(steps),
    )


def _cases(
    space: Space, found: Sorted, group: Group, steps: Sequence[Step], whole: bool
) -> Iterator[tuple[Octuple, ...]]:
    """What must hold in the cluster that has the contact: as little as its place says, if the `whole` place can do the step."""
    _, kind, ends, _, _ = group
    able = sorted({_with_contact(step) for step in steps})
    for form in able[:1] if whole else able:
        outline = found.outlines[form]
        margin = found.uniform[_place(found, steps[0])] if whole else frozenset(outline.margin)
        shown = list(needed(outline, space, margin))
        for changed, edge in shown:
            if edge in outline.edges and (edge.kind, _sides(outline.cluster.nodes, edge)) == (kind, ends):
                yield normal(space, [changed, *(each for each, _ in shown if each != changed)])


def contact_of(space: Space, ends: tuple[tuple[int, int], tuple[int, int]]) -> Octuple:
    """The template of the contacts of two slots: a joker for the object, and for the anchor point if there are several."""
    points = []
    for kind, slot in ends:
        token, at = space.types[kind], space.types[kind].slots[slot]
        named = at.anchors[0] if len(at.anchors) == 1 else ANY
        instance = token.members[0][at.position] if len(token.members) == 1 else ANY
        points.append(Quadruple(token.classes[at.position], instance, at.anchor_class, named))
    return Octuple(points[0], points[1])


def _ends(space: Space, ends: tuple[tuple[int, int], tuple[int, int]]) -> list[str]:
    return [space.types[kind].slot_name(slot) for kind, slot in ends]


def _transfers(space: Space, found: Sorted, steps: Sequence[Step]) -> Iterator[Transfer]:
    """What moves from where to where. If several steps move different numbers, the least and the most of them."""
    rows: dict[tuple[int, int, int], list[int]] = {}
    for step in steps:
        sums: Counter[tuple[int, int, int]] = Counter()
        for source, target, kind, count in step.moved:
            ends = found.place_of[step.inputs[source]], found.place_of[step.outputs[target]]
            sums[*ends, kind] += count
        for row, count in sums.items():
            rows.setdefault(row, []).append(count)
    for (source, target, kind), counts in sorted(rows.items()):
        least = min(counts) if len(counts) == len(steps) else 0
        name = space.types[kind].name
        yield Transfer(found.places[source].name, found.places[target].name, name, least, max(counts))


def _restrictions(
    space: Space, ends: tuple[tuple[int, int], tuple[int, int]], kind: str, place: Place
) -> Iterator[Restriction]:
    """The conditions at run time on a contact in clusters of a place."""
    model = space.model
    for form in place.forms:
        cluster = space.forms[form].cluster
        named = Named(cluster, space.types)
        changed = [
            n
            for n, edge in enumerate(cluster.edges)
            if (edge.kind, _sides(cluster.nodes, edge)) == (kind, ends)
        ]
        for each in model.restrictions:
            hits = (found for n in changed for found in describes(model, each.contact, named.contacts[n]))
            if any(
                each.during is None
                or any(
                    next(describes(model, each.during, contact, bound), None) is not None
                    for contact in named.contacts.values()
                )
                for bound in hits
            ):
                yield each
        return


def _sides(nodes: Sequence[int], edge: Edge) -> tuple[tuple[int, int], tuple[int, int]]:
    return (nodes[edge.key], edge.key_slot), (nodes[edge.lock], edge.lock_slot)


def _names(space: Space, found: Sorted, groups: Mapping[Group, Sequence[Step]]) -> dict[Group, str]:
    """A name for each transition: its operator, what it handles, and where; numbers tell the rest apart."""
    names: dict[Group, str] = {}
    wanted = {group: _name(space, found, group, steps[0]) for group, steps in groups.items()}
    count = Counter(wanted.values())
    seen: Counter[str] = Counter()
    for group, name in wanted.items():
        seen[name] += 1
        names[group] = f"{name}_{seen[name]}" if count[name] > 1 else name
    return names


def _name(space: Space, found: Sorted, group: Group, step: Step) -> str:
    makes, kind, ends, _, _ = group
    contact_class = space.model.contact_classes[kind]
    verb = contact_class.make if makes else contact_class.unmake
    names = _ends(space, ends)
    if not any(space.types[each].driven for each, _ in ends):
        return "_".join([verb, *names])
    handled = names[1] if space.types[ends[0][0]].driven else names[0]
    outline = found.outlines[_with_contact(step)]
    return "_".join(dict.fromkeys([verb, handled, *_where(space, outline, kind, ends)]))


def _where(
    space: Space, outline: Outline, kind: str, ends: tuple[tuple[int, int], tuple[int, int]]
) -> Iterator[str]:
    """What the handled object is in contact with beside the robot."""
    cluster = outline.cluster
    near = neighbours(cluster)
    for edge in outline.edges:
        if (edge.kind, _sides(cluster.nodes, edge)) != (kind, ends):
            continue
        robot, held = edge.key, edge.lock
        if not space.types[cluster.nodes[robot]].driven:
            robot, held = held, robot
        for other, node in near[held]:
            if node != robot and other in outline.edges:
                slot = other.lock_slot if other.lock == node else other.key_slot
                yield space.types[cluster.nodes[node]].slot_name(slot)
                if space.model.contact_classes[other.kind].over:
                    yield other.kind
        return
