"""Plans as behaviour trees in the XML of BehaviorTree.CPP 4, with series and parallel parts.

Every partial order is the order of such a tree, if some of the parts wait for steps of other parts.
Few have to: a set of steps is first split where everything before comes before everything behind,
then into parts that nothing connects.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from xml.etree import ElementTree

from cellwright.kb.model.domain_model import Domain, Operator
from cellwright.kb.model.plan_model import Plan, Step, StepId
from cellwright.kb.terms import Term, substitute_term

MAX_DEPTH_OF_PARTS = 50  # nested deeper, parts wait for each other instead


@dataclass(frozen=True, slots=True)
class Series:
    """Parts that come one after another."""

    parts: tuple["Part", ...]


@dataclass(frozen=True, slots=True)
class ParallelParts:
    """Parts that run side by side, in an order that can be executed.

    Each begins when all steps that it waits for are done.
    """

    parts: tuple["Part", ...]
    waits: tuple[tuple[StepId, ...], ...]


Part = StepId | Series | ParallelParts


def plan_structure(plan: Plan) -> Part:
    """The tree of a plan. Its order is that of the plan: no step waits for another than in the
    plan, and none for fewer.
    """
    order = _Order(plan)
    return _part_of(order, list(range(len(plan.steps))), 0)


class _Order:
    """What comes before each step, by places in the list of steps."""

    def __init__(self, plan: Plan) -> None:
        places = {step.id: place for place, step in enumerate(plan.steps)}
        self.ids = [step.id for step in plan.steps]
        self.before: list[int] = []  # bits: all steps before
        self.just_before: list[tuple[int, ...]] = []  # of these, those with none between
        for step in plan.steps:
            direct = [places[step_id] for step_id in step.after]
            earlier = 0
            for earlier_place in direct:
                earlier |= self.before[earlier_place]
            self.just_before.append(
                tuple(
                    sorted(
                        earlier_place
                        for earlier_place in {*direct}
                        if not earlier >> earlier_place & 1
                    )
                )
            )
            for earlier_place in direct:
                earlier |= 1 << earlier_place
            self.before.append(earlier)


def _part_of(order: _Order, places: list[int], depth: int) -> Part:
    if len(places) == 1:
        return order.ids[places[0]]
    if len(series := _in_series(order, places)) > 1 or not places:
        return Series(tuple(_part_of(order, group, depth + 1) for group in series))
    if len(apart := _independent_groups(order, places)) > 1 and depth < MAX_DEPTH_OF_PARTS:
        return ParallelParts(
            tuple(_part_of(order, group, depth + 1) for group in apart), ((),) * len(apart)
        )
    return _waiting_chains(order, places)


def _in_series(order: _Order, places: list[int]) -> list[list[int]]:
    """The places cut wherever everything before comes before everything behind.

    Cuts are found from the end.
    """
    cuts, common, inside = [len(places)], -1, 0
    for place in places:
        inside |= 1 << place
    for at in range(len(places) - 1, 0, -1):
        common &= order.before[places[at]]
        inside &= ~(1 << places[at])
        if not inside & ~common:
            cuts.append(at)
    cuts.append(0)
    return [places[start:end] for end, start in pairwise(cuts) if start < end][::-1]


def _independent_groups(order: _Order, places: list[int]) -> list[list[int]]:
    """The places in groups between which there is no order, in the order of their first places."""
    top = {place: place for place in places}

    def find(node: int) -> int:
        while top[node] != node:
            top[node] = top[top[node]]
            node = top[node]
        return node

    for place_entry in places:
        for before in order.just_before[place_entry]:
            if before in top:
                first, second = sorted((find(place_entry), find(before)))
                top[second] = first
    groups: dict[int, list[int]] = {}
    for each in places:
        groups.setdefault(find(each), []).append(each)
    return list(groups.values())


def _waiting_chains(order: _Order, places: list[int]) -> ParallelParts:
    """Chains of steps side by side, which wait for steps of each other."""
    chains = list(_step_chains(order, places))
    inside = {*places}
    waits = [
        tuple(
            order.ids[earlier_place]
            for earlier_place in order.just_before[chain[0]]
            if earlier_place in inside
        )
        for chain in chains
    ]
    ids = [tuple(order.ids[chain_place] for chain_place in chain) for chain in chains]
    return ParallelParts(
        tuple(chain_ids[0] if len(chain_ids) == 1 else Series(chain_ids) for chain_ids in ids),
        tuple(waits),
    )


def _step_chains(order: _Order, places: Sequence[int]) -> Iterator[list[int]]:
    """The places as chains: a step joins the step before it if that is the only one before it
    and it is the only one behind.
    """
    inside = {*places}
    behind: dict[int, list[int]] = {}
    for place in places:
        for before in order.just_before[place]:
            behind.setdefault(before, []).append(place)
    chains: dict[int, list[int]] = {}
    for place in places:
        first = [predecessor for predecessor in order.just_before[place] if predecessor in inside]
        joins = len(first) == 1 and len(behind[first[0]]) == 1
        chain = chains[first[0]] if joins else []
        chain.append(place)
        chains[place] = chain
    yield from (chain for start, chain in chains.items() if chain[0] == start)


RESERVED_PORTS = ("ID", "name")  # attributes that every node has
MAIN_TREE = "Plan"


def write_behaviour_tree(domain: Domain, plan: Plan) -> str:
    """The behaviour tree of a plan.

    It succeeds when all steps have, and fails as soon as one does.
    """
    root = ElementTree.Element("root", BTCPP_format="4", main_tree_to_execute=MAIN_TREE)
    tree = ElementTree.SubElement(root, "BehaviorTree", ID=MAIN_TREE)
    operators = {operator.name: operator for operator in domain.operators}
    if plan.steps:
        _Tree(plan, operators).write(tree)
    else:
        ElementTree.SubElement(tree, "AlwaysSuccess")
    used = {step.operator.name for step in plan.steps}
    root.append(
        _node_models(
            [used_operator for used_operator in domain.operators if used_operator.name in used],
            domain,
        )
    )
    ElementTree.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ElementTree.tostring(root, "unicode") + "\n"


class _Tree:
    def __init__(self, plan: Plan, operators: Mapping[str, Operator]) -> None:
        self.steps = {step.id: step for step in plan.steps}
        self.operators = operators
        self.whole = plan_structure(plan)
        self.flags = {waited_for for waits in _waits_of(self.whole) for waited_for in waits}

    def write(self, parent: ElementTree.Element) -> None:
        if self.flags:
            parent = ElementTree.SubElement(parent, "Sequence")
            code = "; ".join(f"{_done_flag(flag)}:=false" for flag in sorted(self.flags))
            ElementTree.SubElement(parent, "Script", code=code)
        self._part(parent, self.whole, ())

    def _part(self, parent: ElementTree.Element, part: Part, waits: tuple[StepId, ...]) -> None:
        until = {"_skipIf": f"!({' && '.join(map(_done_flag, waits))})"} if waits else {}
        match part:
            case Series(parts):
                node = ElementTree.SubElement(parent, "Sequence", until)
                for child in parts:
                    self._part(node, child, ())
            case ParallelParts(parts, each_waits):
                counts = {"success_count": str(len(parts)), "failure_count": "1"}
                node = ElementTree.SubElement(parent, "Parallel", {**counts, **until})
                for child, its in zip(parts, each_waits, strict=True):
                    self._part(node, child, its)
            case step:
                self._action(parent, self.steps[step], until)

    def _action(self, parent: ElementTree.Element, step: Step, until: Mapping[str, str]) -> None:
        attributes = {"ID": step.operator.name, "name": f"{step.id}: {step.operator}"}
        attributes |= _port_values(self.operators[step.operator.name], step)
        attributes |= until
        if step.id in self.flags:
            attributes["_onSuccess"] = f"{_done_flag(step.id)}:=true"
        ElementTree.SubElement(parent, "Action", attributes)


def _waits_of(part: Part) -> Iterator[tuple[StepId, ...]]:
    """What any part waits for."""
    match part:
        case Series(parts):
            for child in parts:
                yield from _waits_of(child)
        case ParallelParts(parts, waits):
            yield from waits
            for child in parts:
                yield from _waits_of(child)


def _done_flag(step: StepId) -> str:
    return f"done_{step}"


def _port_name(variable: str) -> str:
    """The port of a variable. A port must not begin with `_` or be the name of an attribute."""
    name = variable.lstrip("_") or "Any"
    return f"{name}_" if name in RESERVED_PORTS else name


def _operator_ports(operator: Operator) -> dict[str, str]:
    """The variables of an operator and their ports, all of them different."""
    ports: dict[str, str] = {}
    for variable in operator.variables:
        name = _port_name(variable.name)
        while name in ports.values():
            name += "_"
        ports[variable.name] = name
    return ports


def _port_values(operator: Operator, step: Step) -> dict[str, str]:
    """What the ports of an action are given."""
    ports = list(_operator_ports(operator).values())
    values = {port: str(value) for port, value in zip(ports, step.operator.arguments, strict=True)}
    if step.duration:
        values["duration"] = str(step.duration)
    if operator.command is not None:
        bound = dict(zip(operator.variables, step.operator.arguments, strict=True))
        values |= {
            name: str(substitute_term(term, bound))
            for name, term in _command_terms(operator).items()
        }
    return values


def _command_terms(operator: Operator) -> dict[str, Term]:
    if operator.command is None:
        return {}
    said = {"stream": operator.command.stream, "reply": operator.command.reply}
    return said if operator.command.result is None else {**said, "result": operator.command.result}


def _node_models(operators: list[Operator], domain: Domain) -> ElementTree.Element:
    """What each action is: its ports, with their types."""
    models = ElementTree.Element("TreeNodesModel")
    for operator in operators:
        model = ElementTree.SubElement(models, "Action", ID=operator.name)
        ports = _operator_ports(operator)
        for parameter in operator.parameters:
            number = parameter.type in ("int", "time")
            _declare_port(
                model,
                ports[parameter.variable.name],
                "int" if number else "std::string",
                parameter.type,
            )
        _declare_port(model, "duration", "int", f"how long it takes, in {domain.time_unit}", "0")
        for name, meaning in (
            ("stream", "whom the command goes to, and what it says"),
            ("reply", "the reply when it is done"),
            ("result", "the fact that the reply gives"),
        ):
            if name in _command_terms(operator):
                _declare_port(model, name, "std::string", meaning)
    return models


def _declare_port(
    model: ElementTree.Element, name: str, type: str, meaning: str, default: str | None = None
) -> None:
    attributes = {"name": name, "type": type} | ({} if default is None else {"default": default})
    ElementTree.SubElement(model, "input_port", attributes).text = meaning
