"""Plans as behaviour trees, in the XML of BehaviorTree.CPP version 4.

Each operator is an action whose ports are the operator's variables and what its command says. Sequences and parallels
keep the order of the plan. Where that is not the order of a tree, a part is skipped at each tick until flags on the
blackboard say that the steps it waits for are done; a parallel asks a part that was skipped again.
"""

from collections.abc import Iterator, Mapping
from xml.etree import ElementTree

from cellwright.engine.formats.interop.behaviour_trees.structure import Beside, Part, Series, structure
from cellwright.kb.model.domain import Domain, Operator
from cellwright.kb.model.plan import Plan, Step, StepId
from cellwright.kb.terms import Term, substitute

RESERVED = ("ID", "name")  # attributes that every node has
MAIN = "Plan"


def written(domain: Domain, plan: Plan) -> str:
    """The behaviour tree of a plan. It succeeds when all steps have, and fails as soon as one does."""
    root = ElementTree.Element("root", BTCPP_format="4", main_tree_to_execute=MAIN)
    tree = ElementTree.SubElement(root, "BehaviorTree", ID=MAIN)
    operators = {operator.name: operator for operator in domain.operators}
    if plan.steps:
        _Tree(plan, operators).write(tree)
    else:
        ElementTree.SubElement(tree, "AlwaysSuccess")
    used = {step.operator.name for step in plan.steps}
    root.append(_models([each for each in domain.operators if each.name in used], domain))
    ElementTree.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ElementTree.tostring(root, "unicode") + "\n"


class _Tree:
    def __init__(self, plan: Plan, operators: Mapping[str, Operator]) -> None:
        self.steps = {step.id: step for step in plan.steps}
        self.operators = operators
        self.whole = structure(plan)
        self.flags = {each for waits in _waits(self.whole) for each in waits}

    def write(self, parent: ElementTree.Element) -> None:
        if self.flags:
            parent = ElementTree.SubElement(parent, "Sequence")
            code = "; ".join(f"{_flag(each)}:=false" for each in sorted(self.flags))
            ElementTree.SubElement(parent, "Script", code=code)
        self._part(parent, self.whole, ())

    def _part(self, parent: ElementTree.Element, part: Part, waits: tuple[StepId, ...]) -> None:
        until = {"_skipIf": f"!({' && '.join(map(_flag, waits))})"} if waits else {}
        match part:
            case Series(parts):
                node = ElementTree.SubElement(parent, "Sequence", until)
                for each in parts:
                    self._part(node, each, ())
            case Beside(parts, each_waits):
                counts = {"success_count": str(len(parts)), "failure_count": "1"}
                node = ElementTree.SubElement(parent, "Parallel", {**counts, **until})
                for each, its in zip(parts, each_waits, strict=True):
                    self._part(node, each, its)
            case step:
                self._action(parent, self.steps[step], until)

    def _action(self, parent: ElementTree.Element, step: Step, until: Mapping[str, str]) -> None:
        attributes = {"ID": step.operator.name, "name": f"{step.id}: {step.operator}"}
        attributes |= _values(self.operators[step.operator.name], step)
        attributes |= until
        if step.id in self.flags:
            attributes["_onSuccess"] = f"{_flag(step.id)}:=true"
        ElementTree.SubElement(parent, "Action", attributes)


def _waits(part: Part) -> Iterator[tuple[StepId, ...]]:
    """What any part waits for."""
    match part:
        case Series(parts):
            for each in parts:
                yield from _waits(each)
        case Beside(parts, waits):
            yield from waits
            for each in parts:
                yield from _waits(each)


def _flag(step: StepId) -> str:
    return f"done_{step}"


def _port(variable: str) -> str:
    """The port of a variable. A port must not begin with `_` or be the name of an attribute."""
    name = variable.lstrip("_") or "Any"
    return f"{name}_" if name in RESERVED else name


def _ports(operator: Operator) -> dict[str, str]:
    """The variables of an operator and their ports, all of them different."""
    found: dict[str, str] = {}
    for variable in operator.variables:
        name = _port(variable.name)
        while name in found.values():
            name += "_"
        found[variable.name] = name
    return found


def _values(operator: Operator, step: Step) -> dict[str, str]:
    """What the ports of an action are given."""
    ports = list(_ports(operator).values())
    values = {port: str(value) for port, value in zip(ports, step.operator.arguments, strict=True)}
    if step.duration:
        values["duration"] = str(step.duration)
    if operator.command is not None:
        bound = dict(zip(operator.variables, step.operator.arguments, strict=True))
        values |= {name: str(substitute(term, bound)) for name, term in _command(operator).items()}
    return values


def _command(operator: Operator) -> dict[str, Term]:
    if operator.command is None:
        return {}
    said = {"stream": operator.command.stream, "reply": operator.command.reply}
    return said if operator.command.result is None else {**said, "result": operator.command.result}


def _models(operators: list[Operator], domain: Domain) -> ElementTree.Element:
    """What each action is: its ports, with their types."""
    models = ElementTree.Element("TreeNodesModel")
    for operator in operators:
        model = ElementTree.SubElement(models, "Action", ID=operator.name)
        ports = _ports(operator)
        for parameter in operator.parameters:
            number = parameter.type in ("int", "time")
            _declared(
                model, ports[parameter.variable.name], "int" if number else "std::string", parameter.type
            )
        _declared(model, "duration", "int", f"how long it takes, in {domain.time_unit}", "0")
        for name, meaning in (
            ("stream", "whom the command goes to, and what it says"),
            ("reply", "the reply when it is done"),
            ("result", "the fact that the reply gives"),
        ):
            if name in _command(operator):
                _declared(model, name, "std::string", meaning)
    return models


def _declared(
    model: ElementTree.Element, name: str, type: str, meaning: str, default: str | None = None
) -> None:
    attributes = {"name": name, "type": type} | ({} if default is None else {"default": default})
    ElementTree.SubElement(model, "input_port", attributes).text = meaning
