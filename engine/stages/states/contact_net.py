"""The Petri net of a cell's contact states, by classes of objects: transitions between places,
colours, joints and regions.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence

from cellwright.engine.model.task_space import (
    ContactEdge,
    ContactNet,
    ContactStep,
    FormSpace,
    NetPlace,
    StateGrowth,
    Transfer,
    Transition,
)
from cellwright.engine.stages.states.clusters import NamedCluster, cluster_neighbours
from cellwright.engine.stages.states.global_states import (
    MAX_GLOBAL_STATES,
    reachable_states,
    state_growth,
    state_regions,
)
from cellwright.engine.stages.states.net_places import (
    ClusterOutline,
    SortedForms,
    needed_contacts,
    normal_form,
    sort_places,
)
from cellwright.engine.stages.states.token_types import handled_objects_of_joints, permanent_bodies
from cellwright.kb.model.contact_model import (
    ANY,
    Octuple,
    Quadruple,
    Restriction,
    template_bindings,
)

Group = tuple[bool, str, tuple[tuple[int, int], tuple[int, int]], tuple[int, ...], tuple[int, ...]]


def net_transitions(
    space: FormSpace, sorted_forms: SortedForms, used: Iterable[ContactStep]
) -> tuple[Transition, ...]:
    """The transitions of the steps that can be taken, named after their operators, in the order
    of their places.
    """
    groups: dict[Group, list[ContactStep]] = {}
    for step in sorted(used):
        groups.setdefault(_step_group(sorted_forms, step), []).append(step)
    ordered = sorted(
        groups,
        key=lambda group_entry: (
            group_entry[3],
            group_entry[4],
            not group_entry[0],
            group_entry[1:3],
        ),
    )
    names = _transition_names(space, sorted_forms, {group: groups[group] for group in ordered})
    able: Able = {}
    for steps in groups.values():
        for step in steps:
            able.setdefault(
                (*_step_group(sorted_forms, step)[:3], _place_number(sorted_forms, step)), set()
            ).add(_with_contact(step))
    return tuple(
        _build_transition(space, sorted_forms, group, groups[group], names[group], groups, able)
        for group in ordered
    )


Able = dict[tuple[bool, str, tuple[tuple[int, int], tuple[int, int]], int], set[int]]


def _with_contact(step: ContactStep) -> int:
    """The form in which the contact of a step holds."""
    return (step.outputs if step.makes else step.inputs)[0]


def _place_number(sorted_forms: SortedForms, step: ContactStep) -> int:
    return sorted_forms.place_of[_with_contact(step)]


def _step_group(sorted_forms: SortedForms, step: ContactStep) -> Group:
    inputs = tuple(sorted(sorted_forms.place_of[form] for form in step.inputs))
    outputs = tuple(sorted(sorted_forms.place_of[form] for form in step.outputs))
    return step.makes, step.kind, step.ends, inputs, outputs


def _build_transition(
    space: FormSpace,
    sorted_forms: SortedForms,
    group: Group,
    steps: Sequence[ContactStep],
    name: str,
    groups: Mapping[Group, object],
    able: Able,
) -> Transition:
    makes, kind, ends, inputs, outputs = group
    contact_class = space.model.contact_classes[kind]
    joint = _place_number(sorted_forms, steps[0])
    whole = able[makes, kind, ends, joint] == set(sorted_forms.places[joint].forms)
    return Transition(
        name,
        f"{contact_class.make if makes else contact_class.unmake} "
        f"{' - '.join(_end_classes(space, ends))}",
        contact_class.make if makes else contact_class.unmake,
        makes,
        contact_of(space, ends),
        tuple(sorted_forms.places[number].name for number in inputs),
        tuple(sorted_forms.places[number].name for number in outputs),
        tuple(_step_transfers(space, sorted_forms, steps)),
        tuple(_runtime_restrictions(space, ends, kind, sorted_forms.places[joint])),
        (not makes, kind, ends, outputs, inputs) in groups,
        tuple(dict.fromkeys(_transition_cases(space, sorted_forms, group, steps, whole))),
        tuple(steps),
    )


def _transition_cases(
    space: FormSpace,
    sorted_forms: SortedForms,
    group: Group,
    steps: Sequence[ContactStep],
    whole: bool,
) -> Iterator[tuple[Octuple, ...]]:
    """What must hold in the cluster that has the contact: as little as its place says, if the
    `whole` place can do the step.
    """
    _, kind, ends, _, _ = group
    able = sorted({_with_contact(step) for step in steps})
    for form in able[:1] if whole else able:
        outline = sorted_forms.outlines[form]
        margin = (
            sorted_forms.uniform[_place_number(sorted_forms, steps[0])]
            if whole
            else frozenset(outline.margin)
        )
        shown = list(needed_contacts(outline, space, margin))
        for changed, edge in shown:
            if edge in outline.edges and (edge.kind, _edge_sides(outline.cluster.nodes, edge)) == (
                kind,
                ends,
            ):
                yield normal_form(
                    space, [changed, *(octuple for octuple, _ in shown if octuple != changed)]
                )


def contact_of(space: FormSpace, ends: tuple[tuple[int, int], tuple[int, int]]) -> Octuple:
    """The template of the contacts of two slots: a joker for the object, and for the anchor
    point if there are several.
    """
    points = []
    for kind, slot in ends:
        token, at = space.types[kind], space.types[kind].slots[slot]
        named = at.anchors[0] if len(at.anchors) == 1 else ANY
        instance = token.members[0][at.position] if len(token.members) == 1 else ANY
        points.append(Quadruple(token.classes[at.position], instance, at.anchor_class, named))
    return Octuple(points[0], points[1])


def _end_classes(space: FormSpace, ends: tuple[tuple[int, int], tuple[int, int]]) -> list[str]:
    return [space.types[kind].slot_name(slot) for kind, slot in ends]


def _step_transfers(
    space: FormSpace, sorted_forms: SortedForms, steps: Sequence[ContactStep]
) -> Iterator[Transfer]:
    """What moves from where to where.

    If several steps move different numbers, the least and the most of them.
    """
    rows: dict[tuple[int, int, int], list[int]] = {}
    for step in steps:
        sums: Counter[tuple[int, int, int]] = Counter()
        for source, target, kind, count in step.moved:
            ends = (
                sorted_forms.place_of[step.inputs[source]],
                sorted_forms.place_of[step.outputs[target]],
            )
            sums[*ends, kind] += count
        for row, count in sums.items():
            rows.setdefault(row, []).append(count)
    for (source, target, kind), counts in sorted(rows.items()):
        least = min(counts) if len(counts) == len(steps) else 0
        name = space.types[kind].name
        yield Transfer(
            sorted_forms.places[source].name,
            sorted_forms.places[target].name,
            name,
            least,
            max(counts),
        )


def _runtime_restrictions(
    space: FormSpace, ends: tuple[tuple[int, int], tuple[int, int]], kind: str, place: NetPlace
) -> Iterator[Restriction]:
    """The conditions at run time on a contact in clusters of a place."""
    model = space.model
    for form in place.forms:
        cluster = space.forms[form].cluster
        named = NamedCluster(cluster, space.types)
        changed = [
            n
            for n, edge in enumerate(cluster.edges)
            if (edge.kind, _edge_sides(cluster.nodes, edge)) == (kind, ends)
        ]
        for restriction in model.restrictions:
            hits = (
                binding
                for n in changed
                for binding in template_bindings(model, restriction.contact, named.contacts[n])
            )
            if any(
                restriction.during is None
                or any(
                    next(template_bindings(model, restriction.during, contact, bound), None)
                    is not None
                    for contact in named.contacts.values()
                )
                for bound in hits
            ):
                yield restriction
        return


def _edge_sides(nodes: Sequence[int], edge: ContactEdge) -> tuple[tuple[int, int], tuple[int, int]]:
    return (nodes[edge.key], edge.key_slot), (nodes[edge.lock], edge.lock_slot)


def _transition_names(
    space: FormSpace, sorted_forms: SortedForms, groups: Mapping[Group, Sequence[ContactStep]]
) -> dict[Group, str]:
    """A name for each transition: its operator, what it handles, and where; numbers tell the
    rest apart.
    """
    names: dict[Group, str] = {}
    base_names = {
        group: _operator_name(space, sorted_forms, group, steps[0])
        for group, steps in groups.items()
    }
    count = Counter(base_names.values())
    seen: Counter[str] = Counter()
    for group, name in base_names.items():
        seen[name] += 1
        names[group] = f"{name}_{seen[name]}" if count[name] > 1 else name
    return names


def _operator_name(
    space: FormSpace, sorted_forms: SortedForms, group: Group, step: ContactStep
) -> str:
    makes, kind, ends, _, _ = group
    contact_class = space.model.contact_classes[kind]
    verb = contact_class.make if makes else contact_class.unmake
    names = _end_classes(space, ends)
    if not any(space.types[node].driven for node, _ in ends):
        return "_".join([verb, *names])
    handled = names[1] if space.types[ends[0][0]].driven else names[0]
    outline = sorted_forms.outlines[_with_contact(step)]
    return "_".join(dict.fromkeys([verb, handled, *_contact_names(space, outline, kind, ends)]))


def _contact_names(
    space: FormSpace,
    outline: ClusterOutline,
    kind: str,
    ends: tuple[tuple[int, int], tuple[int, int]],
) -> Iterator[str]:
    """What the handled object is in contact with beside the robot."""
    cluster = outline.cluster
    near = cluster_neighbours(cluster)
    for edge in outline.edges:
        if (edge.kind, _edge_sides(cluster.nodes, edge)) != (kind, ends):
            continue
        robot, handled = edge.key, edge.lock
        if not space.types[cluster.nodes[robot]].driven:
            robot, handled = handled, robot
        for neighbour, node in near[handled]:
            if node != robot and neighbour in outline.edges:
                slot = neighbour.lock_slot if neighbour.lock == node else neighbour.key_slot
                yield space.types[cluster.nodes[node]].slot_name(slot)
                if space.model.contact_classes[neighbour.kind].over:
                    yield neighbour.kind
        return


def net_of(space: FormSpace, full: bool = False, most: int = MAX_GLOBAL_STATES) -> ContactNet:
    """The net of a space. With `full`, every form is a place.

    Global states are searched up to `most` of them.
    """
    graph = reachable_states(space, most)
    sorted_forms = sort_places(space, graph, full)
    steps = (
        space.steps
        if graph is None
        else dict.fromkeys(step for following in graph.values() for step, _ in following)
    )
    count: StateGrowth = state_growth(space, graph)
    return ContactNet(
        space.model.name,
        sorted_forms.places,
        net_transitions(space, sorted_forms, steps),
        {
            token_type.name: tuple("+".join(member) for member in token_type.members)
            for token_type in space.types
        },
        {
            joint: tuple(_handling_places(space, sorted_forms, objects))
            for joint, objects in handled_objects_of_joints(space.model).items()
        },
        space.removed,
        count,
        state_regions(space, graph) if graph is not None else (),
        space.complete and graph is not None,
    )


def _handling_places(
    space: FormSpace, sorted_forms: SortedForms, objects: tuple[str, ...]
) -> Iterator[str]:
    """The places in which a robot holds one of these objects; all of them if a controller does
    without.
    """
    driven = permanent_bodies(space.model).driven
    for place in sorted_forms.places:
        named = NamedCluster(space.forms[place.forms[0]].cluster, space.types)
        pairs = [
            {contact.first.instance, contact.second.instance} for contact in named.contacts.values()
        ]
        kinds = {space.model.objects[name] for name in objects}
        if not objects or any(
            pair & driven and kinds & {space.model.objects[name] for name in pair - driven}
            for pair in pairs
        ):
            yield place.name
