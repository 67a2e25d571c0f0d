"""What a name is, in a few lines for people: its signature, what is written about it, where it is used, an example."""

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from cellwright.kb.editing.context import context
from cellwright.kb.editing.index import ASP, FileIndex, Index, Symbol
from cellwright.kb.editing.occurrences import Declared, Occurrence
from cellwright.kb.model.domain import BUILT_IN_TYPES
from cellwright.kb.schema import keys_at

MOST = 5  # objects of a type that are shown


@dataclass(frozen=True)
class Known:
    """What only a domain that loads can tell: an instance of each operator and predicate, and the types of parameters."""

    examples: Mapping[str, str] = field(default_factory=dict)
    parameters: Mapping[str, Mapping[str, str]] = field(default_factory=dict)


def description(index: Index, file: FileIndex, offset: int, known: Known) -> tuple[str, int, int] | None:
    """What stands at a place of a file, as Markdown, and from where to where its name goes; None if there is nothing to say."""
    found = index.symbol(file, offset)
    if found is None:
        return _of_key(file, offset)
    symbol, place = found
    lines = list(_lines(index, file, symbol, known))
    return ("\n\n".join(lines), place.start, place.end) if lines else None


def _lines(index: Index, file: FileIndex, symbol: Symbol, known: Known) -> Iterator[str]:
    if symbol.space == "variable":
        yield _of_variable(index, file, symbol, known)
        return
    declared = index.declarations.get((symbol.space, symbol.name), [])
    if not declared:
        yield from _undeclared(index, symbol)
        return
    home, first = declared[0]
    kind = first.kind if symbol.space != "operator" else "operator"
    yield f"```\n{_signature(first, known)}\n```\n{kind}{_weight(home, first)}"
    if said := comment(home, first.start):
        yield said
    if symbol.space == "device":
        return
    if symbol.space == "type":
        yield _values(index, symbol.name)
    elif example := known.examples.get(symbol.name) or _example(index, first):
        yield f"for example `{example}`"
    yield _used(index, symbol)


def _signature(first: Declared, known: Known) -> str:
    types = known.parameters.get(first.name, {}) if first.space == "operator" else {}
    if not types:
        return first.written()
    inner = (f"{each}: {types[each]}" if each in types else each for each in first.arguments)
    return f"{first.name}({', '.join(inner)})"


def _of_variable(index: Index, file: FileIndex, symbol: Symbol, known: Known) -> str:
    uses = [each for _, each in index.uses(symbol)]
    operator = next((each.name for each in _beside(file, symbol.piece) if each.space == "operator"), "")
    type_ = known.parameters.get(operator, {}).get(symbol.name) or _narrowest(index, uses)
    times = f"{len(uses)} time{'' if len(uses) == 1 else 's'} here"
    return f"```\n{symbol.name}{f': {type_}' if type_ else ''}\n```\nvariable, {times}"


def _beside(file: FileIndex, piece: int) -> Iterator[Occurrence]:
    _, names = file.pieces[piece]
    yield from (each for each in names.occurrences if each.doing == "declared")


def _narrowest(index: Index, uses: list[Occurrence]) -> str:
    """The lowest type of the arguments as which a variable occurs."""
    found = ""
    for each in uses:
        for space in ("predicate", "function"):
            declared = index.declarations.get((space, each.head))
            if declared and each.number < len(declared[0][1].arguments):
                type_ = declared[0][1].arguments[each.number]
                found = type_ if not found or index.is_a(type_, found) else found
    return found


def _undeclared(index: Index, symbol: Symbol) -> Iterator[str]:
    """What is known of a name that no YAML file declares."""
    if symbol.space == "type" and symbol.name in BUILT_IN_TYPES:
        yield f"```\n{symbol.name}\n```\nbuilt-in type"
    elif any(each.doing == "defined" for _, each in index.uses(symbol)):
        yield f"```\n{symbol.name}\n```\npredicate that only rules define and read"
        yield _used(index, symbol)


def _weight(file: FileIndex, first: Declared) -> str:
    """The weight that is written behind a declaration."""
    line = file.text[first.end : file.text.find("\n", first.end)]
    _, found, weight = line.partition("weight:")
    return (
        f" of weight {weight.strip(' ').split('}')[0].strip()}"
        if found and "#" not in line.split("weight:")[0]
        else ""
    )


def _values(index: Index, type_: str) -> str:
    objects = [each.name for each in index.of_space("object") if index.is_a(each.of, type_) and each.of]
    functions = [each.written() for each in index.of_space("function") if index.is_a(each.of, type_)]
    shown = [f"`{each}`" for each in (*objects[:MOST], *functions[:MOST])]
    more = f" and {len(objects) - MOST} more" if len(objects) > MOST else ""
    return f"values: {', '.join(shown)}{more}" if shown else "no values yet"


def _example(index: Index, first: Declared) -> str:
    """An instance with the first object of each type; empty if a type has none."""
    if first.space not in ("predicate", "function") or not first.arguments:
        return ""
    chosen = []
    for type_ in first.arguments:
        sample = {"int": "1", "time": "60", "text": '"a text"'}.get(type_) or next(
            (each.name for each in index.of_space("object") if index.is_a(each.of, type_)), ""
        )
        if not sample:
            return ""
        chosen.append(sample)
    return f"{first.name}({', '.join(chosen)})"


def _used(index: Index, symbol: Symbol) -> str:
    """How often a name is read, added, denied, ..., and in how many files."""
    counts: Counter[str] = Counter()
    files = set()
    for file, each in index.uses(symbol):
        if each.doing != "declared":
            counts[each.doing] += 1
            files.add(file.path)
    if not counts:
        return "not used yet"
    told = ", ".join(
        f"{doing} {count} time{'' if count == 1 else 's'}" for doing, count in sorted(counts.items())
    )
    return f"{told} in {len(files)} file{'' if len(files) == 1 else 's'}"


def comment(file: FileIndex, offset: int) -> str:
    """What is written about the line of a place: the comment behind it, else the comment lines right above it."""
    mark = "%" if file.kind == ASP else "#"
    start = file.text.rfind("\n", 0, offset) + 1
    line = file.text[start:].partition("\n")[0]
    _, found, said = line.partition(f" {mark}")
    if found and line.split(f" {mark}")[0].count('"') % 2 == 0:
        return said.strip()
    lines: list[str] = []
    for above in reversed(file.text[:start].splitlines()):
        if not above.strip().startswith(mark) or "yaml-language-server" in above:
            break
        lines.insert(0, above.strip().lstrip(mark).strip())
    return " ".join(lines)


def _of_key(file: FileIndex, offset: int) -> tuple[str, int, int] | None:
    """What a key of the schema means."""
    if file.kind == ASP:
        return None
    start = offset
    while start > 0 and (file.text[start - 1].isalnum() or file.text[start - 1] == "_"):
        start -= 1
    end = offset
    while end < len(file.text) and (file.text[end].isalnum() or file.text[end] == "_"):
        end += 1
    at, key = context(file.text, start), file.text[start:end]
    said = keys_at(file.kind, at.path).get(key, "") if at.key and file.text[end : end + 1] == ":" else ""
    return (f"**{key}**\n\n{said}", start, end) if said else None
