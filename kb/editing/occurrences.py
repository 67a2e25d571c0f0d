"""The names in one piece of a file: where each stands, what it is, what is done with it there, and what is declared.

Places count from the beginning of the piece, so what was read of a piece is remembered wherever the piece moves.
"""

import re
from collections.abc import Callable
from functools import lru_cache
from typing import NamedTuple

from cellwright.kb.editing.shapes import KINDS, TEXT, Role, Shape
from cellwright.kb.editing.tokens import Mention, mentions
from cellwright.kb.loader.node import Node
from cellwright.kb.loader.tolerant import Piece, tree_of

MAX_RANGE = 10_000  # names of one range that are told apart
RANGE = re.compile(r"([a-z][A-Za-z0-9_]*?)([0-9]{1,9})\.\.(?:\1)?([0-9]{1,9})")
SLOT = re.compile(r"\{\s*([A-Z_]\w*)\s*(?::\s*([a-z]\w*))?\s*\}")


class Occurrence(NamedTuple):
    """A name in a text. `space` says what it names; `head` and `number` which argument of what it is.

    `ranged` names are written as a range, such as depot_1..4. `scope` tells the variables of several statements apart.
    """

    space: str
    name: str
    start: int
    end: int
    doing: str = "named"
    head: str = ""
    number: int = 0
    ranged: bool = False
    scope: int = 0

    def moved(self, by: int) -> "Occurrence":
        """The same, further on in a text."""
        return self._replace(start=self.start + by, end=self.end + by)


class Declared(NamedTuple):
    """A declaration: of a predicate or function with the types of its arguments, of a type, of an object with its type."""

    space: str
    name: str
    kind: str
    start: int
    end: int
    arguments: tuple[str, ...] = ()
    of: str = ""  # the parent of a type, the type of an object, the result of a function

    def moved(self, by: int) -> "Declared":
        """The same, further on in a text."""
        return self._replace(start=self.start + by, end=self.end + by)

    def written(self) -> str:
        """Its signature."""
        inner = f"({', '.join(self.arguments)})" if self.arguments else ""
        return f"{self.name}{inner}" + (f": {self.of}" if self.of else "")


class Names(NamedTuple):
    """What one piece of a file holds."""

    occurrences: tuple[Occurrence, ...] = ()
    declared: tuple[Declared, ...] = ()


@lru_cache(16_384)
def names_of(kind: str, piece: Piece) -> Names:
    """The names in a piece of a YAML file of a kind. The place of the piece is not looked at."""
    root = tree_of(piece.text)
    if root is None:
        return Names()
    shape = KINDS[kind]
    reader = _Reader()
    if piece.section:
        shape = shape.under(piece.section)
    reader.read(root, shape, piece.section)
    found = sorted(reader.occurrences, key=lambda each: each.start)
    return Names(tuple(found), tuple(reader.declared))


class _Reader:
    """Walks a tree and its shape side by side."""

    def __init__(self) -> None:
        self.occurrences: list[Occurrence] = []
        self.declared: list[Declared] = []

    def read(self, node: Node, shape: Shape, key: str) -> None:
        """Note all names in a node. `key` is the mapping or list that it stands in."""
        if isinstance(node.value, str):
            self.scalar(node, shape.role, shape.doing, key)
        elif isinstance(node.value, list):
            for item in node.value:
                self.read(item, shape.items or TEXT, key)
        else:
            for name, (key_node, value) in node.value.items():
                if shape.key is not None and name not in shape.keys:
                    self.scalar(key_node, shape.key, shape.key_doing, key, value)
                self.read(value, shape.under(name), name)

    def scalar(self, node: Node, role: Role, doing: str, key: str, value: Node | None = None) -> None:
        """Note the names in a scalar; `value` stands beside it if it is a key."""
        if read := _ROLES.get(role):
            read(self, node, doing, key, value)

    def note(self, space: str, name: str, start: int, end: int, doing: str) -> None:
        """Note one name."""
        self.occurrences.append(Occurrence(space, name, start, end, doing))

    def mentioned(self, node: Node, each: Mention, doing: str, space: str = "") -> None:
        """Note a name or variable of an expression."""
        space = space or space_of(each)
        start = node.offset_of(each.start)
        outer = each.head == ""
        self.occurrences.append(
            Occurrence(
                space,
                each.name,
                start,
                start + len(each.name),
                doing if outer else "named",
                each.head,
                each.number,
            )
        )

    def atoms(self, node: Node, doing: str, _key: str, _value: Node | None) -> None:
        for each in mentions(node.value):
            self.mentioned(node, each, doing)

    def terms(self, node: Node, doing: str, _key: str, _value: Node | None) -> None:
        for each in mentions(node.value, terms=True):
            self.mentioned(node, each, doing or "named")

    def step(self, node: Node, doing: str, _key: str, _value: Node | None) -> None:
        for each in mentions(node.value, terms=True):
            self.mentioned(node, each, doing or "named", "" if each.head or each.variable else "operator")

    def signature(self, node: Node, doing: str, _key: str, value: Node | None) -> None:
        found = mentions(node.value)
        if not found or found[0].variable:
            return
        first, *arguments = found
        space = "function" if doing == "function" else "predicate"
        self.mentioned(node, first, "declared", space)
        for each in arguments:
            self.mentioned(node, each, "named", "type")
        start = node.offset_of(first.start)
        of = value.value if value is not None and isinstance(value.value, str) else ""
        types = tuple(each.name for each in arguments)
        self.declared.append(Declared(space, first.name, doing, start, start + len(first.name), types, of))

    def header(self, node: Node, _doing: str, _key: str, _value: Node | None) -> None:
        found = mentions(node.value)
        if not found or found[0].variable:
            return
        first, *arguments = found
        self.mentioned(node, first, "declared", "operator")
        for each in arguments:
            self.mentioned(node, each, "declared")
        start, names = node.offset_of(first.start), tuple(each.name for each in arguments)
        self.declared.append(
            Declared("operator", first.name, "operator", start, start + len(first.name), names)
        )

    def type(self, node: Node, _doing: str, _key: str, _value: Node | None) -> None:
        self.note("type", node.value, node.start, node.end, "named")

    def new_type(self, node: Node, _doing: str, _key: str, value: Node | None) -> None:
        self.note("type", node.value, node.start, node.end, "declared")
        of = value.value if value is not None and isinstance(value.value, str) else ""
        self.declared.append(Declared("type", node.value, "type", node.start, node.end, of=of))
        for item in value.value if value is not None and isinstance(value.value, list) else ():
            self._objects(item, node.value)

    def listed(self, node: Node, _key: str, value: Node | None) -> None:
        """Note a type and the objects of it."""
        self.note("type", node.value, node.start, node.end, "named")
        for item in value.value if value is not None and isinstance(value.value, list) else ():
            self._objects(item, node.value)

    def _objects(self, node: Node, type_: str) -> None:
        if not isinstance(node.value, str):
            return
        names = expanded(node.value)
        for name in names:
            found = Occurrence("object", name, node.start, node.end, "declared", ranged=names != [node.value])
            self.occurrences.append(found)
            self.declared.append(Declared("object", name, "object", node.start, node.end, of=type_))

    def thing(self, node: Node, doing: str, _key: str, _value: Node | None) -> None:
        names = expanded(node.value)
        found = re.match(r"[a-z]\w*", node.value)
        if names != [node.value]:
            for name in names:
                self.occurrences.append(
                    Occurrence("object", name, node.start, node.end, "named", ranged=True)
                )
        elif found:
            start = node.offset_of(0)
            self.note("object", found[0], start, start + found.end(), doing or "named")
        elif re.match(r"[A-Z]", node.value):
            for each in mentions(node.value, terms=True):
                self.mentioned(node, each, "named")

    def pattern(self, node: Node, _doing: str, _key: str, _value: Node | None) -> None:
        self.declared.append(Declared("phrase", node.value, "phrase", node.start, node.end))
        for found in SLOT.finditer(node.value):
            for group, space in ((1, "variable"), (2, "type")):
                if found[group]:
                    start = node.offset_of(found.start(group))
                    self.note(space, found[group], start, start + len(found[group]), "named")

    def new_cause(self, node: Node, _doing: str, _key: str, _value: Node | None) -> None:
        self.note("cause", node.value, node.start, node.end, "declared")
        self.declared.append(Declared("cause", node.value, "cause", node.start, node.end))


def _plain(space: str) -> Callable[[_Reader, Node, str, str, Node | None], None]:
    """Reads a scalar that is one name."""

    def read(reader: _Reader, node: Node, _doing: str, _key: str, _value: Node | None) -> None:
        start = node.offset_of(0)
        reader.note(space, node.value, start, start + len(node.value), "named")

    return read


def _type(reader: _Reader, node: Node, doing: str, key: str, value: Node | None) -> None:
    if key == "objects":
        reader.listed(node, key, value)
    else:
        reader.type(node, doing, key, value)


_ROLES: dict[Role, Callable[[_Reader, Node, str, str, Node | None], None]] = {
    Role.ATOMS: _Reader.atoms,
    Role.TERMS: _Reader.terms,
    Role.STEP: _Reader.step,
    Role.SIGNATURE: _Reader.signature,
    Role.HEADER: _Reader.header,
    Role.TYPE: _type,
    Role.NEW_TYPE: _Reader.new_type,
    Role.THING: _Reader.thing,
    Role.PATTERN: _Reader.pattern,
    Role.NEW_CAUSE: _Reader.new_cause,
    Role.VARIABLE: _plain("variable"),
    Role.PREDICATE: _plain("predicate"),
    Role.CAUSE: _plain("cause"),
    Role.FILE: _plain("file"),
    Role.DEVICE: _plain("device"),
    Role.DOMAIN: _plain("domain"),
}


def space_of(each: Mention) -> str:
    """What a name in an expression names, by its place alone."""
    if each.variable:
        return "variable"
    if each.atom:
        return "predicate"
    return "function" if each.called else "object"


def expanded(text: str) -> list[str]:
    """The names of a range such as depot_1..4; else the text alone."""
    found = RANGE.fullmatch(text.strip())
    if found is None:
        return [text]
    first, last = int(found[2]), int(found[3])
    width = len(found[2]) if found[2].startswith("0") else 0
    return [f"{found[1]}{number:0{width}d}" for number in range(first, min(last, first + MAX_RANGE) + 1)]
