"""What fits at a place: keys of the schema, predicates, objects of the right type, variables in scope, phrases."""

import re
from collections.abc import Collection, Iterable, Iterator
from typing import NamedTuple

from cellwright.kb.editing.context import Context, context
from cellwright.kb.editing.index import ASP, FileIndex, Index
from cellwright.kb.editing.occurrences import Declared
from cellwright.kb.editing.shapes import Role, Shape
from cellwright.kb.editing.tokens import mentions
from cellwright.kb.model.domain import BUILT_IN_TYPES
from cellwright.kb.schema import keys_at, values_at

PARTIAL = re.compile(r"[A-Za-z0-9_']*$")
MOST = 2000  # completions that are offered at once
READABLE = ("static", "derived predicate", "fluent", "quantity")
KINDS = {
    "where": ("static", "derived predicate"),
    "adds": ("fluent", "event"),
    "deletes": ("fluent",),
    "implies": ("fluent",),
    "denies": ("fluent",),
    "statics": ("static",),
    "initial": ("fluent", "quantity"),
    "defaults": ("fluent",),
    "stages": ("fluent", "event"),
    "stage": ("fluent", "event"),
    "goal": ("fluent", "derived predicate", "static", "quantity"),
}
"""For some keys of a file: the kinds of predicates that are allowed there; elsewhere all that can be read."""


class Completion(NamedTuple):
    """Something that fits. `insert` is written in place of the `length` characters before the place; it is a snippet."""

    label: str
    kind: str
    detail: str = ""
    text: str = ""
    insert: str = ""
    length: int = 0
    rank: int = 0


def completions(index: Index, file: FileIndex, offset: int) -> list[Completion]:
    """What fits at a place of a file, the best first."""
    if file.kind == ASP:
        found = list(_in_rules(index, file, offset))
    else:
        at = context(file.text, offset)
        found = [] if re.search(r"(^|\s)#", at.written) else list(_in_yaml(index, file, offset, at))
    distinct = {(each.label, each.kind): each for each in reversed(found)}
    ranked = sorted(distinct.values(), key=lambda each: (each.rank, each.label))
    return ranked[:MOST]


def _in_yaml(index: Index, file: FileIndex, offset: int, at: Context) -> Iterator[Completion]:
    shape, length = at.shape(file.kind), len(_partial(at.written))
    if at.key:
        yield from _keys(index, file, at, shape)
    yield from (Completion(each, "value", length=length) for each in values_at(file.kind, at.path))
    match shape.role:
        case Role.ATOMS | Role.TERMS | Role.STEP:
            section = str(next((part for part in reversed(at.path) if part != 0), ""))
            allowed = KINDS.get(section, (*READABLE, "event") if file.kind == "faults" else READABLE)
            yield from _expression(index, file, offset, at.written, allowed, shape.role)
        case Role.THING:
            yield from _objects(index, _listed_type(index, file, offset, at), length)
        case Role.SENTENCE:
            yield from _phrases(index, at)
        case _:
            yield from _of_names(index, shape.role, at, length)


def _of_names(index: Index, role: Role, at: Context, length: int) -> Iterator[Completion]:
    """What fits where a single name stands."""
    slot = role is Role.PATTERN and re.search(r"\{\s*[A-Z_]\w*\s*:\s*\w*$", at.written)
    if role is Role.TYPE or slot:
        yield from _types(index, length)
    elif role in _SPACES:
        yield from (_named(each, length) for each in index.of_space(_SPACES[role]))


_SPACES = {Role.PREDICATE: "predicate", Role.CAUSE: "cause"}


def _keys(index: Index, file: FileIndex, at: Context, shape: Shape) -> Iterator[Completion]:
    """The keys that a mapping may have, or the names that stand in their place."""
    length = len(at.written)
    for key, description in keys_at(file.kind, at.path).items():
        under = shape.under(key)
        more = ":\n  " if under.keys or under.key is not None else ": "
        yield Completion(key, "key", "", description, f"{key}{more if under.items is None else ': '}", length)
    match shape.key:
        case Role.TYPE | Role.THING:
            yield from (each._replace(insert=f"{each.label}: ") for each in _types(index, length))
            yield from _objects(index, "object", length) if shape.key is Role.THING else ()
        case Role.SIGNATURE if "(" in at.written:
            yield from _types(index, len(_partial(at.written)))
        case Role.CAUSE:
            yield from (_named(each, length) for each in index.of_space("cause"))
        case Role.STEP:
            yield from (_named(each, length) for each in index.of_space("operator"))
        case _:
            return


def _expression(
    index: Index,
    file: FileIndex,
    offset: int,
    before: str,
    allowed: Collection[str],
    role: Role,
    asp: bool = False,
) -> Iterator[Completion]:
    """What fits in an expression, of which the text before the place is given."""
    partial = _partial(before)
    rest = before[: len(before) - len(partial)]
    if rest.count('"') % 2:
        return
    here = mentions(f"{rest}zz", asp, role is not Role.ATOMS)[-1:]
    if not here or here[0].start != len(rest):
        return
    place = here[0]
    if place.head:
        wanted = _argument_type(index, place.head, place.number)
        yield from _terms(index, wanted, len(partial))
    elif role is Role.STEP:
        yield from (_named(each, len(partial)) for each in index.of_space("operator"))
    elif place.atom:
        yield from _predicates(index, allowed, len(partial), asp)
    else:
        yield from _terms(index, "object", len(partial))
    yield from _variables(file, offset, len(partial))


def _predicates(index: Index, allowed: Collection[str], length: int, asp: bool) -> Iterator[Completion]:
    for each in index.of_space("predicate"):
        if each.kind in allowed:
            yield _named(each, length)
    if "static" in allowed:
        for each in index.of_space("type"):
            yield Completion(
                each.name, "type", f"{each.name}(object)", "", f"{each.name}(${{1:X}})", length, 2
            )
    if asp:
        yield from _own_predicates(index, length)


def _own_predicates(index: Index, length: int) -> Iterator[Completion]:
    """Predicates that only rules know."""
    for file in index.files.values():
        if file.kind == ASP:
            for _, each in file.occurrences():
                if each.doing == "defined" and ("predicate", each.name) not in index.declarations:
                    yield Completion(each.name, "predicate", "of the rules", length=length, rank=1)


def _argument_type(index: Index, head: str, number: int) -> str:
    """The type of an argument of a predicate or function; of a type, itself; else `object`."""
    for space in ("predicate", "function"):
        if found := index.declarations.get((space, head)):
            arguments = found[0][1].arguments
            return arguments[number] if number < len(arguments) else "object"
    return head if ("type", head) in index.declarations else "object"


def _terms(index: Index, wanted: str, length: int) -> Iterator[Completion]:
    yield from _objects(index, wanted, length)
    for each in index.of_space("function"):
        if index.is_a(each.of, wanted):
            yield _named(each, length)


def _objects(index: Index, wanted: str, length: int) -> Iterator[Completion]:
    if wanted in BUILT_IN_TYPES and wanted != "object":
        return
    for each in index.of_space("object"):
        if index.is_a(each.of, wanted):
            yield Completion(each.name, "object", each.of, length=length)


def _types(index: Index, length: int) -> Iterator[Completion]:
    for each in index.of_space("type"):
        yield Completion(each.name, "type", f"below {each.of}" if each.of else "a closed list", length=length)
    for name in BUILT_IN_TYPES:
        yield Completion(name, "type", "built in", length=length, rank=1)


def _variables(file: FileIndex, offset: int, length: int) -> Iterator[Completion]:
    """The variables of the entry or rule around a place."""
    found = file.around(offset)
    for each in found:
        if each.space == "variable" and each.name != "_" and not each.start <= offset <= each.end:
            yield Completion(each.name, "variable", "variable", length=length, rank=-1)


def _named(each: Declared, length: int) -> Completion:
    """A predicate, function or operator, with places for its arguments."""
    inner = ", ".join(f"${{{n}:{name.capitalize()}}}" for n, name in enumerate(each.arguments, 1))
    insert = f"{each.name}({inner})" if inner else each.name
    return Completion(each.name, each.space, f"{each.kind} {each.written()}", "", insert, length)


def _listed_type(index: Index, file: FileIndex, offset: int, at: Context) -> str:
    """The type of what is listed: that of its key, or of the variable in the stages that it is bound for."""
    key = next((part for part in reversed(at.path) if part != 0), "")
    if ("type", key) in index.declarations:
        return str(key)
    for each in file.around(offset):
        if each.space == "variable" and each.name == key and each.head:
            return _argument_type(index, each.head, each.number)
    return "object"


def _partial(text: str) -> str:
    found = PARTIAL.search(text)
    return found[0] if found else ""


def _in_rules(index: Index, file: FileIndex, offset: int) -> Iterator[Completion]:
    start = max(file.text.rfind(mark, 0, offset) for mark in (".\n", ". ", "\n\n")) + 1
    before = file.text[max(start, 0) : offset]
    if "%" in before.rpartition("\n")[2]:
        return iter(())
    allowed = ("static", "derived predicate", "fluent", "event")
    return _expression(index, file, offset, before, allowed, Role.ATOMS, True)


def _phrases(index: Index, at: Context) -> Iterator[Completion]:
    """The sentences of the domain, each with places for its slots."""
    begun = re.split(r"(?:,|\band\b|\bthen\b)\s*", at.written)[-1]
    for each in index.of_space("phrase"):
        said = _spoken(each.name)
        yield Completion(_plain(said), "phrase", "", each.name, _snippet(index, said), len(begun.lstrip()))


def _spoken(pattern: str) -> str:
    """The shortest sentence of a pattern: options left out, the first of alternatives."""
    before = ""
    while before != pattern:
        before = pattern
        pattern = re.sub(r"\[[^\[\]()]*\]", " ", pattern)
        pattern = re.sub(r"\(([^()\[\]|]*)(?:\|[^()\[\]]*)?\)", r"\1", pattern)
    return " ".join(pattern.split())


def _plain(sentence: str) -> str:
    return re.sub(r"\{\s*\w+\s*(?::\s*(\w+))?\s*\}", lambda found: f"<{found[1] or 'object'}>", sentence)


def _snippet(index: Index, sentence: str) -> str:
    """A sentence with a choice of objects for each slot."""
    numbers = iter(range(1, 100))

    def slot(found: re.Match[str]) -> str:
        type_ = found[2] or "object"
        known = list(_names_of_type(index, type_))[:30]
        return f"${{{next(numbers)}|{','.join(known)}|}}" if known else f"${{{next(numbers)}:{type_}}}"

    return re.sub(r"\{\s*(\w+)\s*(?::\s*(\w+))?\s*\}", slot, sentence)


def _names_of_type(index: Index, type_: str) -> Iterable[str]:
    return (each.label for each in _objects(index, type_, 0))
