"""What an editor shows of a file: its outline, and a description of each name in it."""

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from cellwright.kb.editing.name_index import ASP_KIND, FileIndex, NameIndex, Symbol
from cellwright.kb.editing.name_occurrences import NameDeclaration, Occurrence
from cellwright.kb.editing.yaml_context import context_at
from cellwright.kb.loader.tolerant_yaml import YamlPiece, piece_tree, split_pieces
from cellwright.kb.loader.yaml_tree import YamlNode
from cellwright.kb.model.domain_model import BUILT_IN_TYPES
from cellwright.kb.schema import keys_at

MAX_SHOWN_OBJECTS = 5  # objects of a type that are shown


@dataclass(frozen=True)
class DomainKnowledge:
    """What only a domain that loads can tell: an instance of each operator and predicate, and
    the types of parameters.
    """

    examples: Mapping[str, str] = field(default_factory=dict)
    parameters: Mapping[str, Mapping[str, str]] = field(default_factory=dict)


def describe_name(
    index: NameIndex, file: FileIndex, offset: int, known: DomainKnowledge
) -> tuple[str, int, int] | None:
    """What stands at a place of a file, as Markdown, and from where to where its name goes;
    None if there is nothing to say.
    """
    symbol_found = index.symbol(file, offset)
    if symbol_found is None:
        return _of_key(file, offset)
    symbol, place = symbol_found
    lines = list(_description_lines(index, file, symbol, known))
    return ("\n\n".join(lines), place.start, place.end) if lines else None


def _description_lines(
    index: NameIndex, file: FileIndex, symbol: Symbol, known: DomainKnowledge
) -> Iterator[str]:
    if symbol.space == "variable":
        yield _of_variable(index, file, symbol, known)
        return
    declared = index.declarations.get((symbol.space, symbol.name), [])
    if not declared:
        yield from _describe_undeclared(index, symbol)
        return
    home, first = declared[0]
    kind = first.kind if symbol.space != "operator" else "operator"
    yield f"```\n{_symbol_signature(first, known)}\n```\n{kind}{_declared_weight(home, first)}"
    if comment_text := comment_at(home, first.start):
        yield comment_text
    if symbol.space == "device":
        return
    if symbol.space == "type":
        yield _type_values(index, symbol.name)
    elif example := known.examples.get(symbol.name) or _example_instance(index, first):
        yield f"for example `{example}`"
    yield _usage_counts(index, symbol)


def _symbol_signature(first: NameDeclaration, known: DomainKnowledge) -> str:
    types = known.parameters.get(first.name, {}) if first.space == "operator" else {}
    if not types:
        return first.written()
    inner = (
        f"{argument}: {types[argument]}" if argument in types else argument
        for argument in first.arguments
    )
    return f"{first.name}({', '.join(inner)})"


def _of_variable(index: NameIndex, file: FileIndex, symbol: Symbol, known: DomainKnowledge) -> str:
    uses = [occurrence for _, occurrence in index.uses(symbol)]
    operator = next(
        (
            occurrence.name
            for occurrence in _declared_beside(file, symbol.piece)
            if occurrence.space == "operator"
        ),
        "",
    )
    type_ = known.parameters.get(operator, {}).get(symbol.name) or _narrowest_type(index, uses)
    times = f"{len(uses)} time{'' if len(uses) == 1 else 's'} here"
    return f"```\n{symbol.name}{f': {type_}' if type_ else ''}\n```\nvariable, {times}"


def _declared_beside(file: FileIndex, piece: int) -> Iterator[Occurrence]:
    _, names = file.pieces[piece]
    yield from (occurrence for occurrence in names.occurrences if occurrence.doing == "declared")


def _narrowest_type(index: NameIndex, uses: list[Occurrence]) -> str:
    """The lowest type of the arguments as which a variable occurs."""
    narrowest = ""
    for use in uses:
        for space in ("predicate", "function"):
            declared = index.declarations.get((space, use.head))
            if declared and use.number < len(declared[0][1].arguments):
                type_ = declared[0][1].arguments[use.number]
                narrowest = type_ if not narrowest or index.is_a(type_, narrowest) else narrowest
    return narrowest


def _describe_undeclared(index: NameIndex, symbol: Symbol) -> Iterator[str]:
    """What is known of a name that no YAML file declares."""
    if symbol.space == "type" and symbol.name in BUILT_IN_TYPES:
        yield f"```\n{symbol.name}\n```\nbuilt-in type"
    elif any(occurrence.doing == "defined" for _, occurrence in index.uses(symbol)):
        yield f"```\n{symbol.name}\n```\npredicate that only rules define and read"
        yield _usage_counts(index, symbol)


def _declared_weight(file: FileIndex, first: NameDeclaration) -> str:
    """The weight that is written behind a declaration."""
    line = file.text[first.end : file.text.find("\n", first.end)]
    _, weight_key, weight = line.partition("weight:")
    return (
        f" of weight {weight.strip(' ').split('}')[0].strip()}"
        if weight_key and "#" not in line.split("weight:")[0]
        else ""
    )


def _type_values(index: NameIndex, type_: str) -> str:
    objects = [
        declared.name
        for declared in index.of_space("object")
        if index.is_a(declared.of, type_) and declared.of
    ]
    functions = [
        declared.written()
        for declared in index.of_space("function")
        if index.is_a(declared.of, type_)
    ]
    shown = [
        f"`{value_name}`"
        for value_name in (*objects[:MAX_SHOWN_OBJECTS], *functions[:MAX_SHOWN_OBJECTS])
    ]
    more = (
        f" and {len(objects) - MAX_SHOWN_OBJECTS} more" if len(objects) > MAX_SHOWN_OBJECTS else ""
    )
    return f"values: {', '.join(shown)}{more}" if shown else "no values yet"


def _example_instance(index: NameIndex, first: NameDeclaration) -> str:
    """An instance with the first object of each type; empty if a type has none."""
    if first.space not in ("predicate", "function") or not first.arguments:
        return ""
    chosen = []
    for type_ in first.arguments:
        sample = {"int": "1", "time": "60", "text": '"a text"'}.get(type_) or next(
            (
                declared.name
                for declared in index.of_space("object")
                if index.is_a(declared.of, type_)
            ),
            "",
        )
        if not sample:
            return ""
        chosen.append(sample)
    return f"{first.name}({', '.join(chosen)})"


def _usage_counts(index: NameIndex, symbol: Symbol) -> str:
    """How often a name is read, added, denied, ..., and in how many files."""
    counts: Counter[str] = Counter()
    files = set()
    for file, occurrence in index.uses(symbol):
        if occurrence.doing != "declared":
            counts[occurrence.doing] += 1
            files.add(file.path)
    if not counts:
        return "not used yet"
    usage_text = ", ".join(
        f"{doing} {count} time{'' if count == 1 else 's'}"
        for doing, count in sorted(counts.items())
    )
    return f"{usage_text} in {len(files)} file{'' if len(files) == 1 else 's'}"


def comment_at(file: FileIndex, offset: int) -> str:
    """What is written about the line of a place: the comment behind it, else the comment lines
    right above it.
    """
    mark = "%" if file.kind == ASP_KIND else "#"
    start = file.text.rfind("\n", 0, offset) + 1
    line = file.text[start:].partition("\n")[0]
    _, mark_found, comment_text = line.partition(f" {mark}")
    if mark_found and line.split(f" {mark}")[0].count('"') % 2 == 0:
        return comment_text.strip()
    lines: list[str] = []
    for above in reversed(file.text[:start].splitlines()):
        if not above.strip().startswith(mark) or "yaml-language-server" in above:
            break
        lines.insert(0, above.strip().lstrip(mark).strip())
    return " ".join(lines)


def _of_key(file: FileIndex, offset: int) -> tuple[str, int, int] | None:
    """What a key of the schema means."""
    if file.kind == ASP_KIND:
        return None
    start = offset
    while start > 0 and (file.text[start - 1].isalnum() or file.text[start - 1] == "_"):
        start -= 1
    end = offset
    while end < len(file.text) and (file.text[end].isalnum() or file.text[end] == "_"):
        end += 1
    at, key = context_at(file.text, start), file.text[start:end]
    key_text = (
        keys_at(file.kind, at.path).get(key, "")
        if at.key and file.text[end : end + 1] == ":"
        else ""
    )
    return (f"**{key}**\n\n{key_text}", start, end) if key_text else None


class OutlineEntry(NamedTuple):
    """A part of a file: its name, what it is, where it begins and ends, where its name does,
    and its parts.
    """

    name: str
    kind: str
    start: int
    end: int
    name_start: int
    name_end: int
    parts: tuple["OutlineEntry", ...] = ()


def file_outline(file: FileIndex) -> list[OutlineEntry]:
    """The entries of a file, in its order."""
    if file.kind == ASP_KIND:
        return list(_rule_entries(file))
    entries: list[OutlineEntry] = []
    for piece in split_pieces(file.text):
        root = piece_tree(piece.text)
        if root is None or isinstance(root.value, str):
            continue
        if piece.section and entries:
            parts = tuple(_mapping_entries(piece, root, piece.section))
            last = entries[-1]
            end = max(last.end, parts[-1].end) if parts else last.end
            entries[-1] = last._replace(end=end, parts=(*last.parts, *parts))
        elif not piece.section:
            entries += _mapping_entries(piece, root, "section", True)
    return entries


def _mapping_entries(
    piece: YamlPiece, root: YamlNode, kind: str, deep: bool = False
) -> Iterator[OutlineEntry]:
    """The entries of a mapping, or of a list, by their first lines."""
    if isinstance(root.value, dict):
        for name, (key, value) in root.value.items():
            end = max(_node_end(piece.text, value), key.end)
            inner = piece._replace(text=piece.text)
            parts = (
                tuple(_mapping_entries(inner, value, name))
                if deep and isinstance(value.value, dict)
                else ()
            )
            shown = (
                f"{name}: {value.value}"
                if deep and isinstance(value.value, str) and value.value
                else name
            )
            yield OutlineEntry(shown, kind, piece.start + key.start, piece.start + end,
                        piece.start + key.start, piece.start + key.end, parts)  # fmt: skip
    elif isinstance(root.value, list):
        for item in root.value:
            start = piece.start + item.start
            end = piece.start + max(_node_end(piece.text, item), item.start + 1)
            name = _item_title(item)
            yield OutlineEntry(name, kind, start, end, start, min(end, start + 1))


def _item_title(item: YamlNode) -> str:
    """The name of an item of a list: its text, or its first entry."""
    if isinstance(item.value, str):
        return item.value or "..."
    if isinstance(item.value, dict) and item.value:
        key, (_, value) = next(iter(item.value.items()))
        return f"{key} {value.value}" if isinstance(value.value, str) else key
    return "..."


def _node_end(text: str, node: YamlNode) -> int:
    """Where a node ends, without the blank lines and comments after it."""
    end = node.end
    while end > node.start:
        start = max(text.rfind("\n", node.start, end) + 1, node.start)
        line = text[start:end].strip()
        if line and not (line.startswith("#") and (not start or text[start - 1] == "\n")):
            return end - len(text[start:end]) + len(text[start:end].rstrip())
        end = start - 1
    return node.start


def _rule_entries(file: FileIndex) -> Iterator[OutlineEntry]:
    """For each predicate that the rules of a file define, its rules."""
    entries: dict[str, list[OutlineEntry]] = {}
    for _, occurrence in file.occurrences():
        if occurrence.doing in ("defined", "declared") and not occurrence.head:
            line = file.text[occurrence.start :].partition("\n")[0].strip()
            end = occurrence.start + len(line)
            part = OutlineEntry(
                line[:60],
                "rule",
                occurrence.start,
                max(end, occurrence.end),
                occurrence.start,
                occurrence.end,
            )
            entries.setdefault(occurrence.name, []).append(part)
    for name, rules in entries.items():
        first = rules[0]
        yield OutlineEntry(name, "predicate", first.start, max(rule.end for rule in rules),
                    first.start, first.name_end,
                    tuple(rules) if len(rules) > 1 else ())  # fmt: skip
