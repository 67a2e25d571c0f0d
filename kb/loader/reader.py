"""Reads one YAML file: its form by the schema, and the expressions in it.

Every finding is collected with its place.
"""

import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any

from cellwright.kb.diagnostics import NOWHERE, Diagnostic, InvalidInput, Source
from cellwright.kb.files import File
from cellwright.kb.loader.yaml_tree import MAX_NODES, YamlNode, read_tree
from cellwright.kb.model.statement import Statement
from cellwright.kb.schema import Deviation, find_deviations
from cellwright.kb.syntax import ExpressionError, Parsed, parse_expression
from cellwright.kb.terms import Function, Variable

MAX_OBJECTS = 100_000  # names in one file, with all names of ranges
MAX_FINDINGS = 1000


@dataclass
class LoadFindings:
    """The diagnostics of one load, in the order found."""

    diagnostics: list[Diagnostic] = field(default_factory=list)

    def add(
        self, where: Source, code: str, message: str, hint: str = "", warning: bool = False
    ) -> None:
        """Add one finding."""
        self.note(Diagnostic(where, code, message, hint, warning))

    def note(self, diagnostic: Diagnostic) -> None:
        """Add one finding. Raises `InvalidInput` when there are too many to read."""
        self.diagnostics.append(diagnostic)
        if len(self.diagnostics) > MAX_FINDINGS:
            raise InvalidInput(self.diagnostics)

    def warnings(self) -> tuple[Diagnostic, ...]:
        """The findings, each once, if they are only warnings."""
        return tuple(dict.fromkeys(self.diagnostics))


@dataclass(frozen=True, slots=True)
class Expression:
    """A parsed string of a file: its value, and the place of each function and variable in it."""

    value: Any
    parsed: Parsed
    node: YamlNode

    def place(self, term: Function | Variable | None = None) -> Source:
        """The first place of `term`; the beginning of the string if it does not occur."""
        offset = self.parsed.places.get(term) if term is not None else None
        return self.node.where if offset is None else self.node.place(offset)


class Reader:
    """One file being read: its tree, its findings and its unit of time."""

    def __init__(self, root: YamlNode, findings: LoadFindings, time_unit: str = "s") -> None:
        self.root, self.findings, self.time_unit = root, findings, time_unit
        self.named = 0

    @classmethod
    def of(cls, file: File, findings: LoadFindings, most: int = MAX_NODES) -> "Reader":
        """A reader of a YAML file with at most so many values.

        Raises `InvalidInput` if the file contains no tree.
        """
        root, diagnostics = read_tree(file, most)
        findings.diagnostics.extend(diagnostics)
        return cls(root, findings)

    def expression(self, start: str, *path: str | int) -> Expression | None:
        """The expression at `path`.

        None if there is none, or if it cannot be parsed, which is reported.
        """
        node = self.root
        for part in path:
            if isinstance(node.value, str) or (
                isinstance(node.value, dict) and part not in node.value
            ):
                return None
            node = node.descend((part,))
        return self.parse(start, node)

    def parse(self, start: str, node: YamlNode) -> Expression | None:
        """The expression in a scalar."""
        if not isinstance(node.value, str) or not node.value.strip():
            return None
        try:
            parsed = parse_expression(start, node.value, self.time_unit, _read_aggregate)
        except ExpressionError as error:
            self.findings.add(node.place(error.offset), error.code, error.message, error.hint)
            return None
        return Expression(parsed.value, parsed, node)

    def entries(self, *path: str | int) -> Iterator[tuple[str, YamlNode, YamlNode]]:
        """The (key, key node, value node) of the mapping at `path`, if it is one."""
        node = self.root.descend(path)
        if isinstance(node.value, dict) and self._reached(path):
            for key, (key_node, value) in node.value.items():
                yield key, key_node, value

    def items(self, *path: str | int) -> list[YamlNode]:
        """The nodes of the sequence at `path`, if it is one."""
        node = self.root.descend(path)
        return node.value if isinstance(node.value, list) and self._reached(path) else []

    def place_under(self, section: str) -> Callable[[tuple[str | int, ...], int], Source]:
        """A function from a path under `section` and a character there to its place."""

        def place(path: tuple[str | int, ...], offset: int) -> Source:
            node = self.root.descend((section, *path))
            return node.place(offset) if isinstance(node.value, str) else node.where

        return place

    def text(self, *path: str | int) -> str:
        """The scalar at `path`; empty if there is none."""
        node = self.root.descend(path)
        return node.value if isinstance(node.value, str) and self._reached(path) else ""

    def _reached(self, path: tuple[str | int, ...]) -> bool:
        node = self.root
        for part in path:
            following = node.descend((part,))
            if following is node:
                return False
            node = following
        return True

    def names(self, node: YamlNode) -> list[tuple[str, YamlNode]]:
        """The names in a list node, each with its node.

        Ranges such as `depot_1..4` give all their names.
        """
        names: list[tuple[str, YamlNode]] = []
        for item in node.value if isinstance(node.value, list) else []:
            if isinstance(item.value, str):
                names += [
                    (name, item)
                    for name in self._expand(item.value, item)
                    if self.is_name(name, item)
                ]
        return names

    def once(self, named: Iterable[tuple[str, YamlNode]]) -> Iterator[tuple[str, YamlNode]]:
        """Each name once, with a warning for every repetition."""
        seen: set[str] = set()
        for name, node in named:
            if name in seen:
                message = f"'{name}' is listed twice"
                self.findings.add(node.where, "K111", message, "leave one out", warning=True)
            else:
                seen.add(name)
                yield name, node

    def is_name(self, name: str, node: YamlNode) -> bool:
        """Whether users may use this name. If not, this is reported."""
        if name == "not" or name.startswith("_"):
            hint = (
                "names that begin with '_' belong to the engine"
                if name != "not"
                else "choose another name"
            )
            self.findings.add(node.where, "K112", f"'{name}' is reserved", hint)
            return False
        if re.fullmatch(r"[a-z][A-Za-z0-9_]*", name):
            return True
        hint = "a name is a small letter, then letters, digits and _"
        self.findings.add(node.where, "K112", f"'{name[:60]}' is not a name", hint)
        return False

    def _expand(self, text: str, node: YamlNode) -> list[str]:
        range_ = re.fullmatch(r"([a-z][A-Za-z0-9_]*?)([0-9]+)\.\.([A-Za-z0-9_]*?)([0-9]+)", text)
        if range_ is None or range_[3] not in ("", range_[1]):
            self.named += 1
            return [text]
        if max(len(range_[2]), len(range_[4])) > 9:
            self.findings.add(
                node.where, "K007", "a range of more than nine digits", "count from 1"
            )
            return []
        first, last = int(range_[2]), int(range_[4])
        if last < first:
            self.findings.add(
                node.where, "K113", f"the range {text} is empty", "the smaller number comes first"
            )
            return []
        self.named += last - first + 1
        if self.named > MAX_OBJECTS:
            hint = "describe the cell with fewer names: no planner can handle so many"
            self.findings.add(
                node.where, "K007", f"more than {MAX_OBJECTS} names in one file", hint
            )
            return []
        width = len(range_[2]) if range_[2].startswith("0") else 0
        return [f"{range_[1]}{number:0{width}d}" for number in range(first, last + 1)]


def _read_aggregate(text: str, offset: int) -> Statement:
    """What an aggregate of an expression reads, as the constraint that forbids it.

    Raises `ExpressionError`.
    """
    from cellwright.kb.asp import AspError
    from cellwright.kb.asp.statements import RefusedStatement, read_statements

    try:
        (read,) = read_statements(f":- {text}.", lambda _line, _column: NOWHERE, pools=True)
    except AspError as error:
        hint = "write it as in ASP: #count { X : p(X) }"
        raise ExpressionError(offset, f"in '{text}': {error}", hint) from None
    if isinstance(read, RefusedStatement):
        raise ExpressionError(offset, read.message, read.hint, read.code)
    return read.statement


def validate_shape(reader: Reader, kind: str) -> bool:
    """Whether the file has the form of its kind. Every deviation is reported at its place."""
    differences = find_deviations(kind, reader.root.plain())
    for deviation in differences:
        reader.findings.add(
            _deviation_place(reader.root, deviation), "K005", deviation.message, deviation.hint
        )
    return not differences


def _deviation_place(root: YamlNode, deviation: Deviation) -> Source:
    if deviation.at_key:
        parent = root.descend(deviation.path[:-1])
        if isinstance(parent.value, dict) and deviation.path[-1] in parent.value:
            where: Source = parent.value[deviation.path[-1]][0].where
            return where
    return root.descend(deviation.path).where


def require_valid(findings: LoadFindings) -> None:
    """Raise `InvalidInput` if anything found so far is an error."""
    if any(not diagnostic.warning for diagnostic in findings.diagnostics):
        raise InvalidInput(findings.diagnostics)
