"""Completions at a place of a file: keys, predicates, objects, variables, phrases."""

import re
from collections.abc import Collection, Iterable, Iterator
from typing import NamedTuple

from cellwright.kb.editing.expression_tokens import mentions_in
from cellwright.kb.editing.name_index import ASP_KIND, FileIndex, NameIndex
from cellwright.kb.editing.name_occurrences import NameDeclaration
from cellwright.kb.editing.scalar_roles import Role, ScalarShape
from cellwright.kb.editing.yaml_context import Context, context_at
from cellwright.kb.model.domain_model import BUILT_IN_TYPES
from cellwright.kb.schema import keys_at, values_at

PARTIAL_NAME = re.compile(r"[A-Za-z0-9_']*$")
MAX_COMPLETIONS = 2000  # completions that are offered at once
READABLE_DETAILS = ("static", "derived predicate", "fluent", "quantity")
COMPLETION_KIND_NAMES = {
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
    "windows": ("fluent", "event"),
    "keep": ("fluent", "event"),
    "goal": ("fluent", "derived predicate", "static", "quantity"),
}
"""For some keys of a file: the kinds of predicates that are allowed there; elsewhere all that
can be read.
"""


class Completion(NamedTuple):
    """Something that fits. `insert` is written in place of the `length` characters before the
    place; it is a snippet.
    """

    label: str
    kind: str
    detail: str = ""
    text: str = ""
    insert: str = ""
    length: int = 0
    rank: int = 0


def list_completions(index: NameIndex, file: FileIndex, offset: int) -> list[Completion]:
    """What fits at a place of a file, the best first."""
    if file.kind == ASP_KIND:
        fitting = list(_in_rules(index, file, offset))
    else:
        at = context_at(file.text, offset)
        fitting = (
            [] if re.search(r"(^|\s)#", at.written) else list(_in_yaml(index, file, offset, at))
        )
    distinct = {(completion.label, completion.kind): completion for completion in reversed(fitting)}
    ranked = sorted(distinct.values(), key=lambda completion: (completion.rank, completion.label))
    return ranked[:MAX_COMPLETIONS]


def _in_yaml(index: NameIndex, file: FileIndex, offset: int, at: Context) -> Iterator[Completion]:
    shape, length = at.shape(file.kind), len(_partial_name(at.written))
    if at.key:
        yield from _key_completions(index, file, at, shape)
    yield from (
        Completion(value_name, "value", length=length)
        for value_name in values_at(file.kind, at.path)
    )
    match shape.role:
        case Role.ATOMS | Role.TERMS | Role.STEP | Role.WINDOW | Role.WORKER:
            section = str(next((part for part in reversed(at.path) if part != 0), ""))
            allowed = COMPLETION_KIND_NAMES.get(
                section, (*READABLE_DETAILS, "event") if file.kind == "faults" else READABLE_DETAILS
            )
            yield from _expression_completions(index, file, offset, at.written, allowed, shape.role)
        case Role.THING:
            yield from _object_completions(index, _listed_type(index, file, offset, at), length)
        case Role.SENTENCE:
            yield from _phrase_completions(index, at)
        case _:
            yield from _of_names(index, shape.role, at, length)


def _of_names(index: NameIndex, role: Role, at: Context, length: int) -> Iterator[Completion]:
    """What fits where a single name stands."""
    slot = role is Role.PATTERN and re.search(r"\{\s*[A-Z_]\w*\s*:\s*\w*$", at.written)
    if role is Role.TYPE or slot:
        yield from _type_completions(index, length)
    elif role in _ROLE_SPACES:
        yield from (
            _call_completion(declared, length) for declared in index.of_space(_ROLE_SPACES[role])
        )


_ROLE_SPACES = {Role.PREDICATE: "predicate", Role.CAUSE: "cause"}


def _key_completions(
    index: NameIndex, file: FileIndex, at: Context, shape: ScalarShape
) -> Iterator[Completion]:
    """The keys that a mapping may have, or the names that stand in their place."""
    length = len(at.written)
    for key, description in keys_at(file.kind, at.path).items():
        under = shape.under(key)
        more = ":\n  " if under.keys or under.key is not None else ": "
        yield Completion(
            key, "key", "", description, f"{key}{more if under.items is None else ': '}", length
        )
    match shape.key:
        case Role.TYPE | Role.THING:
            yield from (
                completion._replace(insert=f"{completion.label}: ")
                for completion in _type_completions(index, length)
            )
            yield from (
                _object_completions(index, "object", length) if shape.key is Role.THING else ()
            )
        case Role.SIGNATURE if "(" in at.written:
            yield from _type_completions(index, len(_partial_name(at.written)))
        case Role.CAUSE:
            yield from (_call_completion(declared, length) for declared in index.of_space("cause"))
        case Role.STEP:
            yield from (
                _call_completion(declared, length) for declared in index.of_space("operator")
            )
        case _:
            return


def _expression_completions(
    index: NameIndex,
    file: FileIndex,
    offset: int,
    before: str,
    allowed: Collection[str],
    role: Role,
    asp: bool = False,
) -> Iterator[Completion]:
    """What fits in an expression, of which the text before the place is given."""
    partial = _partial_name(before)
    rest = before[: len(before) - len(partial)]
    if rest.count('"') % 2:
        return
    here = mentions_in(f"{rest}zz", asp, role not in (Role.ATOMS, Role.WINDOW))[-1:]
    if not here or here[0].start != len(rest):
        return
    place = here[0]
    if place.head:
        wanted = _argument_type(index, place.head, place.number)
        yield from _term_completions(index, wanted, len(partial))
    elif role is Role.STEP:
        yield from (
            _call_completion(declared, len(partial)) for declared in index.of_space("operator")
        )
    elif place.atom:
        yield from _predicate_completions(index, allowed, len(partial), asp)
    else:
        yield from _term_completions(index, "object", len(partial))
    if not place.head and role in (Role.WINDOW, Role.WORKER):
        yield from (
            _call_completion(declared, len(partial)) for declared in index.of_space("operator")
        )
    yield from _variable_completions(file, offset, len(partial))


def _predicate_completions(
    index: NameIndex, allowed: Collection[str], length: int, asp: bool
) -> Iterator[Completion]:
    for declared in index.of_space("predicate"):
        if declared.kind in allowed:
            yield _call_completion(declared, length)
    if "static" in allowed:
        for declared in index.of_space("type"):
            yield Completion(
                declared.name,
                "type",
                f"{declared.name}(object)",
                "",
                f"{declared.name}(${{1:X}})",
                length,
                2,
            )
    if asp:
        yield from _own_predicates(index, length)


def _own_predicates(index: NameIndex, length: int) -> Iterator[Completion]:
    """Predicates that only rules know."""
    for file in index.files.values():
        if file.kind == ASP_KIND:
            for _, occurrence in file.occurrences():
                if (
                    occurrence.doing == "defined"
                    and ("predicate", occurrence.name) not in index.declarations
                ):
                    yield Completion(
                        occurrence.name, "predicate", "of the rules", length=length, rank=1
                    )


def _argument_type(index: NameIndex, head: str, number: int) -> str:
    """The type of an argument of a predicate or function; of a type, itself; else `object`."""
    for space in ("predicate", "function"):
        if declared := index.declarations.get((space, head)):
            arguments = declared[0][1].arguments
            return arguments[number] if number < len(arguments) else "object"
    return head if ("type", head) in index.declarations else "object"


def _term_completions(index: NameIndex, wanted: str, length: int) -> Iterator[Completion]:
    yield from _object_completions(index, wanted, length)
    for declared in index.of_space("function"):
        if index.is_a(declared.of, wanted):
            yield _call_completion(declared, length)


def _object_completions(index: NameIndex, wanted: str, length: int) -> Iterator[Completion]:
    if wanted in BUILT_IN_TYPES and wanted != "object":
        return
    for declared in index.of_space("object"):
        if index.is_a(declared.of, wanted):
            yield Completion(declared.name, "object", declared.of, length=length)


def _type_completions(index: NameIndex, length: int) -> Iterator[Completion]:
    for declared in index.of_space("type"):
        yield Completion(
            declared.name,
            "type",
            f"below {declared.of}" if declared.of else "a closed list",
            length=length,
        )
    for name in BUILT_IN_TYPES:
        yield Completion(name, "type", "built in", length=length, rank=1)


def _variable_completions(file: FileIndex, offset: int, length: int) -> Iterator[Completion]:
    """The variables of the entry or rule around a place."""
    occurrences = file.around(offset)
    for occurrence in occurrences:
        if (
            occurrence.space == "variable"
            and occurrence.name != "_"
            and not occurrence.start <= offset <= occurrence.end
        ):
            yield Completion(occurrence.name, "variable", "variable", length=length, rank=-1)


def _call_completion(declared: NameDeclaration, length: int) -> Completion:
    """A predicate, function or operator, with places for its arguments."""
    inner = ", ".join(
        f"${{{n}:{name.capitalize()}}}" for n, name in enumerate(declared.arguments, 1)
    )
    insert = f"{declared.name}({inner})" if inner else declared.name
    return Completion(
        declared.name, declared.space, f"{declared.kind} {declared.written()}", "", insert, length
    )


def _listed_type(index: NameIndex, file: FileIndex, offset: int, at: Context) -> str:
    """The type of what is listed: that of its key, or of the variable in the stages that it is
    bound for.
    """
    key = next((part for part in reversed(at.path) if part != 0), "")
    if ("type", key) in index.declarations:
        return str(key)
    for occurrence in file.around(offset):
        if occurrence.space == "variable" and occurrence.name == key and occurrence.head:
            return _argument_type(index, occurrence.head, occurrence.number)
    return "object"


def _partial_name(text: str) -> str:
    match = PARTIAL_NAME.search(text)
    return match[0] if match else ""


def _in_rules(index: NameIndex, file: FileIndex, offset: int) -> Iterator[Completion]:
    start = max(file.text.rfind(mark, 0, offset) for mark in (".\n", ". ", "\n\n")) + 1
    before = file.text[max(start, 0) : offset]
    if "%" in before.rpartition("\n")[2]:
        return iter(())
    allowed = ("static", "derived predicate", "fluent", "event")
    return _expression_completions(index, file, offset, before, allowed, Role.ATOMS, True)


def _phrase_completions(index: NameIndex, at: Context) -> Iterator[Completion]:
    """The sentences of the domain, each with places for its slots."""
    begun = re.split(r"(?:,|\band\b|\bthen\b)\s*", at.written)[-1]
    for declared in index.of_space("phrase"):
        spoken = _shortest_sentence(declared.name)
        yield Completion(
            _plain_sentence(spoken),
            "phrase",
            "",
            declared.name,
            _sentence_snippet(index, spoken),
            len(begun.lstrip()),
        )


def _shortest_sentence(pattern: str) -> str:
    """The shortest sentence of a pattern: options left out, the first of alternatives."""
    before = ""
    while before != pattern:
        before = pattern
        pattern = re.sub(r"\[[^\[\]()]*\]", " ", pattern)
        pattern = re.sub(r"\(([^()\[\]|]*)(?:\|[^()\[\]]*)?\)", r"\1", pattern)
    return " ".join(pattern.split())


def _plain_sentence(sentence: str) -> str:
    return re.sub(
        r"\{\s*\w+\s*(?::\s*(\w+))?\s*\}", lambda match: f"<{match[1] or 'object'}>", sentence
    )


def _sentence_snippet(index: NameIndex, sentence: str) -> str:
    """A sentence with a choice of objects for each slot."""
    numbers = iter(range(1, 100))

    def slot(match: re.Match[str]) -> str:
        type_ = match[2] or "object"
        names = list(_names_of_type(index, type_))[:30]
        return (
            f"${{{next(numbers)}|{','.join(names)}|}}" if names else f"${{{next(numbers)}:{type_}}}"
        )

    return re.sub(r"\{\s*(\w+)\s*(?::\s*(\w+))?\s*\}", slot, sentence)


def _names_of_type(index: NameIndex, type_: str) -> Iterable[str]:
    return (completion.label for completion in _object_completions(index, type_, 0))
