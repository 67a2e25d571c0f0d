"""The names in one piece of a YAML or ASP file: where each stands and what it is.

Places count from the beginning of the piece, so what was read of a piece is remembered wherever the
piece moves.
"""

import re
from collections.abc import Callable, Iterator
from functools import lru_cache
from typing import NamedTuple

from cellwright.kb.editing.expression_tokens import NameMention, mentions_in, tokens_of
from cellwright.kb.editing.scalar_roles import SHAPE_OF_KIND, TEXT_SHAPE, Role, ScalarShape
from cellwright.kb.loader.tolerant_yaml import YamlPiece, piece_tree
from cellwright.kb.loader.yaml_tree import YamlNode

MAX_RANGE_NAMES = 10_000  # names of one range that are told apart
NUMBERED_NAMES = re.compile(r"([a-z][A-Za-z0-9_]*?)([0-9]{1,9})\.\.(?:\1)?([0-9]{1,9})")
WINDOW_WORDS = {
    *("at", "least", "most", "and", "exactly", "up", "price"),
    *("from", "to", "start", "end", "of", "step", "plan"),
}  # words of a window of time that name nothing
PHRASE_SLOT = re.compile(r"\{\s*([A-Z_]\w*)\s*(?::\s*([a-z]\w*))?\s*\}")


class Occurrence(NamedTuple):
    """A name in a text. `space` says what it names; `head` and `number` which argument of what it
    is.

    `ranged` names are written as a range, such as depot_1..4. `scope` tells the variables of
    several statements apart.
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


class NameDeclaration(NamedTuple):
    """A declaration: of a predicate or function with the types of its arguments, of a type, of
    an object with its type.
    """

    space: str
    name: str
    kind: str
    start: int
    end: int
    arguments: tuple[str, ...] = ()
    of: str = ""  # the parent of a type, the type of an object, the result of a function

    def moved(self, by: int) -> "NameDeclaration":
        """The same, further on in a text."""
        return self._replace(start=self.start + by, end=self.end + by)

    def written(self) -> str:
        """Its signature."""
        inner = f"({', '.join(self.arguments)})" if self.arguments else ""
        return f"{self.name}{inner}" + (f": {self.of}" if self.of else "")


class PieceNames(NamedTuple):
    """What one piece of a file holds."""

    occurrences: tuple[Occurrence, ...] = ()
    declared: tuple[NameDeclaration, ...] = ()


@lru_cache(16_384)
def names_in_yaml(kind: str, piece: YamlPiece) -> PieceNames:
    """The names in a piece of a YAML file of a kind. The place of the piece is not looked at."""
    root = piece_tree(piece.text)
    if root is None:
        return PieceNames()
    shape = SHAPE_OF_KIND[kind]
    reader = _ShapeReader()
    if piece.section:
        shape = shape.under(piece.section)
    reader.read(root, shape, piece.section)
    ordered = sorted(reader.occurrences, key=lambda occurrence: occurrence.start)
    return PieceNames(tuple(ordered), tuple(reader.declared))


class _ShapeReader:
    """Walks a tree and its shape side by side."""

    def __init__(self) -> None:
        self.occurrences: list[Occurrence] = []
        self.declared: list[NameDeclaration] = []

    def read(self, node: YamlNode, shape: ScalarShape, key: str) -> None:
        """Note all names in a node. `key` is the mapping or list that it stands in."""
        if isinstance(node.value, str):
            self.scalar(node, shape.role, shape.doing, key)
        elif isinstance(node.value, list):
            for item in node.value:
                self.read(item, shape.items or TEXT_SHAPE, key)
        else:
            for name, (key_node, value) in node.value.items():
                if shape.key is not None and name not in shape.keys:
                    self.scalar(key_node, shape.key, shape.key_doing, key, value)
                self.read(value, shape.under(name), name)

    def scalar(
        self, node: YamlNode, role: Role, doing: str, key: str, value: YamlNode | None = None
    ) -> None:
        """Note the names in a scalar; `value` stands beside it if it is a key."""
        if read := _ROLE_READERS.get(role):
            read(self, node, doing, key, value)

    def note(self, space: str, name: str, start: int, end: int, doing: str) -> None:
        """Note one name."""
        self.occurrences.append(Occurrence(space, name, start, end, doing))

    def mentioned(self, node: YamlNode, mention: NameMention, doing: str, space: str = "") -> None:
        """Note a name or variable of an expression."""
        space = space or mention_space(mention)
        start = node.offset_of(mention.start)
        outer = mention.head == ""
        self.occurrences.append(
            Occurrence(
                space,
                mention.name,
                start,
                start + len(mention.name),
                doing if outer else "named",
                mention.head,
                mention.number,
            )
        )

    def atoms(self, node: YamlNode, doing: str, _key: str, _value: YamlNode | None) -> None:
        for mention in mentions_in(node.value):
            self.mentioned(node, mention, doing)

    def terms(self, node: YamlNode, doing: str, _key: str, _value: YamlNode | None) -> None:
        for mention in mentions_in(node.value, terms=True):
            self.mentioned(node, mention, doing or "named")

    def step(self, node: YamlNode, doing: str, _key: str, _value: YamlNode | None) -> None:
        for mention in mentions_in(node.value, terms=True):
            self.mentioned(
                node,
                mention,
                doing or "named",
                "" if mention.head or mention.variable else "operator",
            )

    def window(self, node: YamlNode, doing: str, _key: str, _value: YamlNode | None) -> None:
        before = ""
        for mention in mentions_in(node.value):
            if mention.head or mention.variable:
                self.mentioned(node, mention, doing)
            elif mention.called or mention.name not in WINDOW_WORDS:
                self.mentioned(node, mention, doing, "operator" if before == "step" else "event")
            before = "" if mention.head or mention.variable else mention.name

    def worker(self, node: YamlNode, doing: str, _key: str, _value: YamlNode | None) -> None:
        for mention in mentions_in(node.value, terms=True):
            inner = mention.head or mention.variable
            self.mentioned(node, mention, doing, "" if inner else "worker")

    def signature(self, node: YamlNode, doing: str, _key: str, value: YamlNode | None) -> None:
        found_mentions = mentions_in(node.value)
        if not found_mentions or found_mentions[0].variable:
            return
        first, *arguments = found_mentions
        space = "function" if doing == "function" else "predicate"
        self.mentioned(node, first, "declared", space)
        for parameter in arguments:
            self.mentioned(node, parameter, "named", "type")
        start = node.offset_of(first.start)
        of = value.value if value is not None and isinstance(value.value, str) else ""
        types = tuple(typed_parameter.name for typed_parameter in arguments)
        self.declared.append(
            NameDeclaration(space, first.name, doing, start, start + len(first.name), types, of)
        )

    def header(self, node: YamlNode, _doing: str, _key: str, _value: YamlNode | None) -> None:
        found_mentions = mentions_in(node.value)
        if not found_mentions or found_mentions[0].variable:
            return
        first, *arguments = found_mentions
        self.mentioned(node, first, "declared", "operator")
        for parameter in arguments:
            self.mentioned(node, parameter, "declared")
        start, names = (
            node.offset_of(first.start),
            tuple(named_parameter.name for named_parameter in arguments),
        )
        self.declared.append(
            NameDeclaration(
                "operator", first.name, "operator", start, start + len(first.name), names
            )
        )

    def type(self, node: YamlNode, _doing: str, _key: str, _value: YamlNode | None) -> None:
        self.note("type", node.value, node.start, node.end, "named")

    def new_type(self, node: YamlNode, _doing: str, _key: str, value: YamlNode | None) -> None:
        self.note("type", node.value, node.start, node.end, "declared")
        of = value.value if value is not None and isinstance(value.value, str) else ""
        self.declared.append(
            NameDeclaration("type", node.value, "type", node.start, node.end, of=of)
        )
        for item in value.value if value is not None and isinstance(value.value, list) else ():
            self._objects(item, node.value)

    def listed(self, node: YamlNode, _key: str, value: YamlNode | None) -> None:
        """Note a type and the objects of it."""
        self.note("type", node.value, node.start, node.end, "named")
        for item in value.value if value is not None and isinstance(value.value, list) else ():
            self._objects(item, node.value)

    def _objects(self, node: YamlNode, type_: str) -> None:
        if not isinstance(node.value, str):
            return
        names = expand_range(node.value)
        for name in names:
            declared_object = Occurrence(
                "object", name, node.start, node.end, "declared", ranged=names != [node.value]
            )
            self.occurrences.append(declared_object)
            self.declared.append(
                NameDeclaration("object", name, "object", node.start, node.end, of=type_)
            )

    def thing(self, node: YamlNode, doing: str, _key: str, _value: YamlNode | None) -> None:
        names = expand_range(node.value)
        match = re.match(r"[a-z]\w*", node.value)
        if names != [node.value]:
            for name in names:
                self.occurrences.append(
                    Occurrence("object", name, node.start, node.end, "named", ranged=True)
                )
        elif match:
            start = node.offset_of(0)
            self.note("object", match[0], start, start + match.end(), doing or "named")
        elif re.match(r"[A-Z]", node.value):
            for mention in mentions_in(node.value, terms=True):
                self.mentioned(node, mention, "named")

    def pattern(self, node: YamlNode, _doing: str, _key: str, _value: YamlNode | None) -> None:
        self.declared.append(NameDeclaration("phrase", node.value, "phrase", node.start, node.end))
        for slot in PHRASE_SLOT.finditer(node.value):
            for group, space in ((1, "variable"), (2, "type")):
                if slot[group]:
                    start = node.offset_of(slot.start(group))
                    self.note(space, slot[group], start, start + len(slot[group]), "named")

    def new_cause(self, node: YamlNode, _doing: str, _key: str, _value: YamlNode | None) -> None:
        self.note("cause", node.value, node.start, node.end, "declared")
        self.declared.append(NameDeclaration("cause", node.value, "cause", node.start, node.end))


def _plain_reader(
    space: str,
) -> Callable[[_ShapeReader, YamlNode, str, str, YamlNode | None], None]:
    """Reads a scalar that is one name."""

    def read(
        reader: _ShapeReader, node: YamlNode, _doing: str, _key: str, _value: YamlNode | None
    ) -> None:
        start = node.offset_of(0)
        reader.note(space, node.value, start, start + len(node.value), "named")

    return read


def _read_type(
    reader: _ShapeReader, node: YamlNode, doing: str, key: str, value: YamlNode | None
) -> None:
    if key == "objects":
        reader.listed(node, key, value)
    else:
        reader.type(node, doing, key, value)


_ROLE_READERS: dict[Role, Callable[[_ShapeReader, YamlNode, str, str, YamlNode | None], None]] = {
    Role.ATOMS: _ShapeReader.atoms,
    Role.TERMS: _ShapeReader.terms,
    Role.STEP: _ShapeReader.step,
    Role.WINDOW: _ShapeReader.window,
    Role.WORKER: _ShapeReader.worker,
    Role.SIGNATURE: _ShapeReader.signature,
    Role.HEADER: _ShapeReader.header,
    Role.TYPE: _read_type,
    Role.NEW_TYPE: _ShapeReader.new_type,
    Role.THING: _ShapeReader.thing,
    Role.PATTERN: _ShapeReader.pattern,
    Role.NEW_CAUSE: _ShapeReader.new_cause,
    Role.VARIABLE: _plain_reader("variable"),
    Role.PREDICATE: _plain_reader("predicate"),
    Role.CAUSE: _plain_reader("cause"),
    Role.FILE: _plain_reader("file"),
    Role.DEVICE: _plain_reader("device"),
    Role.DOMAIN: _plain_reader("domain"),
}


def mention_space(mention: NameMention) -> str:
    """What a name in an expression names, by its place alone."""
    if mention.variable:
        return "variable"
    if mention.atom:
        return "predicate"
    return "function" if mention.called else "object"


def expand_range(text: str) -> list[str]:
    """The names of a range such as depot_1..4; else the text alone."""
    match = NUMBERED_NAMES.fullmatch(text.strip())
    if match is None:
        return [text]
    first, last = int(match[2]), int(match[3])
    width = len(match[2]) if match[2].startswith("0") else 0
    return [
        f"{match[1]}{number:0{width}d}"
        for number in range(first, min(last, first + MAX_RANGE_NAMES) + 1)
    ]


@lru_cache(4096)
def names_in_rules(text: str) -> PieceNames:
    """The names in a piece of an ASP file.

    A head defines what its atom names; the other atoms are read.
    """
    ends = [token.start for token in tokens_of(text, True) if token.text == "."]
    necks = [token.start for token in tokens_of(text, True) if token.text == ":-"]
    constants = {constant.start for constant in _constant_mentions(text)}
    occurrences: list[Occurrence] = []
    statement = neck = 0
    for mention in mentions_in(text, True):
        while statement < len(ends) and mention.start > ends[statement]:
            statement += 1
        begin = ends[statement - 1] if statement else -1
        while neck < len(necks) and necks[neck] < begin:
            neck += 1
        past = neck < len(necks) and begin < necks[neck] < mention.start
        doing = "declared" if mention.start in constants else "read" if past else "defined"
        doing = doing if mention.atom or doing == "declared" else "named"
        occurrences.append(
            Occurrence(
                mention_space(mention) if doing != "declared" else "object",
                mention.name, mention.start, mention.end, doing, mention.head, mention.number, scope=statement,
            )
        )  # fmt: skip
    declared = [
        NameDeclaration(
            "object",
            constant_mention.name,
            "constant",
            constant_mention.start,
            constant_mention.end,
        )
        for constant_mention in occurrences
        if constant_mention.doing == "declared"
    ]
    return PieceNames(tuple(occurrences), tuple(declared))


def _constant_mentions(text: str) -> Iterator[NameMention]:
    """The names that `#const` declares."""
    starts = [token.end for token in tokens_of(text, True) if token.text == "#const"]
    for start in starts:
        yield from [mention for mention in mentions_in(text, True) if mention.start >= start][:1]
