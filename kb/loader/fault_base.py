"""The fault model in `faults.yaml`. All its names are checked against its domain."""

import re
from collections.abc import Collection, Mapping
from pathlib import Path

from cellwright.kb.diagnostics import Diagnostic, unknown_name
from cellwright.kb.loader.domain_file import read_beside
from cellwright.kb.loader.reader import Expression, Reader, require_valid
from cellwright.kb.loader.symbol_table import SymbolTable
from cellwright.kb.loader.variable_types import Typing
from cellwright.kb.loader.yaml_tree import YamlNode
from cellwright.kb.model.domain_model import Domain, Kind, Operator
from cellwright.kb.model.fault_model import Cause, FaultModel, FaultTest, Interruption, Repair
from cellwright.kb.terms import ANYTHING, Atom, Function, Term, Variable

FAULTS_FILE = "faults.yaml"
_CHANCE = re.compile(r"([a-z][A-Za-z0-9_]*)(?:\s+([0-9](?:\.[0-9]{1,6})?))?")


def load_faults(domain: Path) -> tuple[FaultModel, tuple[Diagnostic, ...]]:
    """The fault base beside a domain file, and warnings. Raises `InvalidInput` with all errors."""
    reader, known, names = read_beside(domain, FAULTS_FILE, "faults", "fault base")
    reader.time_unit = known.time_unit
    model = _FaultReader(reader, known, names).model(str(domain.with_name(FAULTS_FILE)))
    require_valid(reader.findings)
    return model, reader.findings.warnings()


class _FaultReader:
    """Reads one fault base."""

    def __init__(self, reader: Reader, domain: Domain, names: SymbolTable) -> None:
        self.reader, self.domain, self.names = reader, domain, names
        self.operators = {operator.name: operator for operator in domain.operators}
        # for each file: a device has variables of its own
        self.bound: dict[str, dict[Variable, str]] = {}

    def model(self, path: str) -> FaultModel:
        self._name()
        self._probability("lies")
        entries = self._section
        causes = [name for name, _, _ in entries("causes")]
        exceptions = {
            name: self._exception(name, key, node, causes)
            for name, key, node in entries("exceptions")
        }
        return FaultModel(
            self.domain.name,
            exceptions,
            {name: self._cause(name, key, node) for name, key, node in entries("causes")},
            {name: self._test(name, key, node, causes) for name, key, node in entries("tests")},
            {name: self._repair(name, key, node, causes) for name, key, node in entries("repairs")},
            float(self.reader.text("smoothing") or 1.0),
            int(self.reader.text("stop") or 600),
            float(self.reader.text("lies") or 0.01),
            path,
        )

    def _name(self) -> None:
        node = self.reader.root.descend(("faults",))
        if node.value != self.domain.name:
            self.names.findings.note(
                unknown_name("domain", node.value, [self.domain.name], node.where)
            )

    def _probability(self, key: str) -> None:
        if float(self.reader.text(key) or 0.0) > 1.0:
            place = self.reader.root.descend((key,))
            self.names.findings.add(
                place.where, "K901", f"{place.value} is not a probability", "the largest is 1"
            )

    def _section(self, section: str) -> list[tuple[str, YamlNode, YamlNode]]:
        return [
            entry
            for entry in self.reader.entries(section)
            if self.reader.is_name(entry[0], entry[1])
        ]

    def _exception(
        self, name: str, key: YamlNode, node: YamlNode, causes: Collection[str]
    ) -> Interruption:
        counts = {}
        for cause, (place, count) in node.value["causes"][1].value.items():
            if self._known("cause", cause, causes, place):
                counts[cause] = float(count.value)
        if counts and not sum(counts.values()) + float(self.reader.text("smoothing") or 1.0):
            message = (
                "all counts of its causes are 0, and so is `smoothing`: no cause can be the one"
            )
            self.names.findings.add(
                key.where, "K901", message, "count a cause, or let `smoothing` be above 0"
            )
        operator = self._operator(node, "of")
        if operator is not None and (said := _child_node(node, "of")) is not None:
            self._bind(operator, said.file.path)  # another device may have begun the entry
        return Interruption(
            name,
            _child_text(node, "say"),
            counts,
            operator,
            _child_text(node, "reply") or "timeout",
            key.where,
        )

    def _bind(self, header: Function, file: str) -> None:
        """Give the variables of an exception's operator the types of its parameters, in all
        atoms of the file.
        """
        bound = self.bound.setdefault(file, {})
        for argument, parameter in zip(header.arguments, self._of(header).parameters, strict=True):
            if isinstance(argument, Variable):
                bound.setdefault(argument, parameter.type)

    def _types_in(self, file: str) -> dict[Variable, str]:
        """The types of variables in a file.

        What it does not bind itself is bound as in the other files.
        """
        types: dict[Variable, str] = {}
        for bound in (self.bound.get(file, {}), *self.bound.values()):
            for variable, type_ in bound.items():
                types.setdefault(variable, type_)
        return types

    def _cause(self, name: str, key: YamlNode, node: YamlNode) -> Cause:
        return Cause(
            name,
            _child_text(node, "say"),
            self._atoms(node, "doubts"),
            self._atoms(node, "adds"),
            self._atoms(node, "denies"),
            tuple(self._objects(node, "loses")),
            _child_text(node, "stops") == "true",
            _child_text(node, "completes") == "true",
            self._steps(node, "blocks") if _child_node(node, "blocks") else None,
            self._atoms(node, "spoils", (Kind.FLUENT, Kind.EVENT)),
            self._steps(node, "since"),
            key.where,
        )

    def _test(self, name: str, key: YamlNode, node: YamlNode, causes: Collection[str]) -> FaultTest:
        outcomes = tuple(
            outcome for outcome, _ in self.reader.once(self.reader.names(node.value["outcomes"][1]))
        )
        otherwise = node.value["otherwise"][1]
        self._known("outcome", otherwise.value, outcomes, otherwise)
        gives = {}
        for cause, (place, given) in node.value["gives"][1].value.items():
            if self._known("cause", cause, causes, place):
                gives[cause] = self._chances(given, outcomes, otherwise.value)
        return FaultTest(
            name,
            _child_text(node, "say"),
            int(_child_text(node, "cost")),
            outcomes,
            otherwise.value,
            gives,
            self._atoms(node, "preconditions"),
            self._operator(node, "by"),
            _child_text(node, "asks") == "true",
            int(_child_text(node, "duration") or _child_text(node, "cost")),
            key.where,
            int(_child_text(node, "repeats") or 1),
        )

    def _chances(
        self, node: YamlNode, outcomes: Collection[str], otherwise: str
    ) -> Mapping[str, float]:
        """The probabilities in `weak` or `weak 0.9, none 0.05`.

        The rest belongs to the outcome `otherwise`.
        """
        chances: dict[str, float] = {}
        for part in str(node.value).split(","):
            read = _CHANCE.fullmatch(part.strip())
            if read is None:
                message = f"'{part.strip()[:40]}' is not an outcome with a probability"
                self.names.findings.add(
                    node.where, "K901", message, "write it as in `weak 0.9, none 0.1`"
                )
            elif self._known("outcome", read[1], outcomes, node):
                chances[read[1]] = chances.get(read[1], 0.0) + (float(read[2]) if read[2] else 1.0)
        left = 1.0 - sum(chances.values())
        if left < -1e-9:
            message = f"the sum of the probabilities is {1.0 - left:g}"
            self.names.findings.add(node.where, "K901", message, "the sum may be at most 1")
        if left > 1e-9:
            chances[otherwise] = round(chances.get(otherwise, 0.0) + left, 9)
        return chances

    def _repair(self, name: str, key: YamlNode, node: YamlNode, causes: Collection[str]) -> Repair:
        return Repair(
            name,
            _child_text(node, "say"),
            int(_child_text(node, "cost")),
            self._cures(node.value["cures"][1], causes),
            self._atoms(node, "preconditions"),
            self._atoms(node, "adds"),
            self._atoms(node, "denies"),
            self._operator(node, "by"),
            _child_text(node, "asks") == "true",
            int(_child_text(node, "duration") or _child_text(node, "cost")),
            tuple(self._objects(node, "loses")),
            key.where,
        )

    def _cures(self, node: YamlNode, causes: Collection[str]) -> Mapping[str, float]:
        if isinstance(node.value, list):
            listed = self.reader.once((str(item.value), item) for item in node.value)
            return {
                cause: 1.0 for cause, place in listed if self._known("cause", cause, causes, place)
            }
        cures = {}
        for cause, (place, chance) in node.value.items():
            if self._known("cause", cause, causes, place):
                cures[cause] = float(chance.value)
            if float(chance.value) > 1.0:
                self.names.findings.add(
                    chance.where, "K901", f"{chance.value} is not a probability", "the largest is 1"
                )
        return cures

    def _known(self, kind: str, name: str, known: Collection[str], place: YamlNode) -> bool:
        if name in known:
            return True
        self.names.findings.note(unknown_name(kind, name, known, place.where))
        return False

    def _atoms(
        self, node: YamlNode, key: str, kinds: tuple[Kind, ...] = (Kind.FLUENT,)
    ) -> tuple[Atom, ...]:
        """The fluents under a key, or atoms of other `kinds`, checked against their signatures."""
        given = _child_node(node, key)
        expression = self.reader.parse("atoms", given) if given else None
        if given is None or expression is None:
            return ()
        typing = Typing(self.names, self._types_in(given.file.path))
        for atom in expression.value:
            typing.atom(atom, expression, kinds)
        return tuple(expression.value)

    def _objects(self, node: YamlNode, key: str) -> list[Term]:
        given = _child_node(node, key)
        objects: list[Term] = []
        for item in given.value if given else []:
            expression = self.reader.parse("term", item)
            if expression is None:
                continue
            term = expression.value
            if isinstance(term, Function) and not term.arguments:
                self._known("object", term.name, self.domain.objects, item)
            objects.append(term)
        return objects

    def _operator(self, node: YamlNode, key: str) -> Function | None:
        """A step: an operator of the domain with the right number of arguments."""
        given = _child_node(node, key)
        expression = self.reader.parse("term", given) if given else None
        return self._step(expression) if expression is not None else None

    def _steps(self, node: YamlNode, key: str) -> tuple[Function, ...]:
        """Patterns of steps. An operator alone stands for it with whatever arguments."""
        given = _child_node(node, key)
        parsed_steps = (self.reader.parse("term", item) for item in (given.value if given else ()))
        steps = (self._step(step, alone=True) for step in parsed_steps if step is not None)
        return tuple(step for step in steps if step is not None)

    def _step(self, expression: Expression, alone: bool = False) -> Function | None:
        header = expression.value
        if not isinstance(header, Function):
            return None
        if header.name not in self.operators:
            self.names.findings.note(
                unknown_name("operator", header.name, self.operators, expression.place(header))
            )
            return None
        operator = self.operators[header.name]
        if alone and not header.arguments:
            return Function(header.name, (ANYTHING,) * len(operator.parameters))
        if len(header.arguments) != len(operator.parameters):
            message = (
                f"{header.name} takes {len(operator.parameters)} arguments, not "
                f"{len(header.arguments)}"
            )
            self.names.findings.add(
                expression.place(header), "K102", message, f"it is {operator.header}"
            )
            return None
        return header

    def _of(self, header: Function) -> Operator:
        return self.operators[header.name]


def _child_node(node: YamlNode, key: str) -> YamlNode | None:
    if not isinstance(node.value, dict) or key not in node.value:
        return None
    child_node: YamlNode = node.value[key][1]
    return child_node


def _child_text(node: YamlNode, key: str) -> str:
    child_node = _child_node(node, key)
    return str(child_node.value) if child_node else ""
