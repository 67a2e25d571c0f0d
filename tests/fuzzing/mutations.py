"""Mutations that know the form of a file: trees of JSON, YAML and XML, the words of a text, the
bytes of a binary file.

Everything is drawn from the generator that is handed in, so a case is known by its number.
"""

import json
import re
from collections.abc import Callable, Sequence
from functools import lru_cache
from random import Random
from typing import Any
from xml.etree import ElementTree

import yaml

ODD_NUMBERS = [
    "0", "-1", "1e400", "-1e400", "5e18", "nan", "inf", "9" * 5000, "1e-400", "0x1f", "1_0", "\u0663", "\u00b2",
    "2147483648", "-9223372036854775809", "0.1", "+1", "1.", ".5", "1,5", "-0", "00",
]  # fmt: skip
ODD_TEXTS = [
    "", " ", "\x1b[2J", "\x9b1m", "\u202eabc", "\ud800", "\ufeff", "\U0001f600", "p" * 3000, "\u00e9", "\u2028", "_", "X",
    "not", "#script "
    "(python)", "1..10000000", "f(" * 60 + ")" * 60, "../../etc/passwd", "/dev/zero", "%s%n", "&lt;", "]]>",
    "<!--", '"', "'", "\\", "*", "@f(1)", "#const k=1000000000.", "${HOME}", "\0",
]  # fmt: skip
SIGNS = list("()[]{},;:.|'\"#<>=!+-*/\\&@%?~`^_ \t\n\r\0")
ODD_VALUES: list[Any] = [
    None, True, False, [], {}, -1, 0, 10**400, 1e308, float("nan"), float("inf"), [[]], {"": ""},
]  # fmt: skip
DEEP = 40

# Those in C are ten times as fast.
LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
DUMPER = getattr(yaml, "CSafeDumper", yaml.SafeDumper)

Mutation = Callable[[Random, str, Sequence[bytes]], str]


def mutated(chance: Random, kind: str, seeds: Sequence[bytes]) -> bytes:
    """One of the seeds, changed in one to four places. `kind` is json, yaml, xml, text or bytes."""
    data = chance.choice(seeds)
    if kind == "bytes":
        return _bytes(chance, data, seeds)
    others = seeds[:50]
    text = _text(data)
    if kind in TREES and chance.random() < 0.6:
        text = TREES[kind](chance, text, others)
    for _ in range(chance.choice((0, 1, 1, 2, 3, 4))):
        text = chance.choice(TEXTUAL)(chance, text, others)
    encoded = text.encode("utf-8", "surrogatepass" if chance.random() < 0.2 else "replace")
    return _bytes(chance, encoded, seeds) if chance.random() < 0.05 else encoded


@lru_cache(1000)
def _text(data: bytes) -> str:
    return data.decode("utf-8", "replace")


def _bytes(chance: Random, data: bytes, seeds: Sequence[bytes]) -> bytes:
    changed = bytearray(data)
    for _ in range(chance.choice((1, 1, 2, 5, 20))):
        at = chance.randrange(len(changed) + 1)
        match chance.randrange(6):
            case 0 if changed:
                changed[at % len(changed)] ^= 1 << chance.randrange(8)
            case 1:
                changed[at : at + chance.randrange(16)] = bytes(
                    chance.choices(range(256), k=chance.randrange(8))
                )
            case 2:
                del changed[at:]
            case 3:
                other = chance.choice(seeds)
                begin = chance.randrange(len(other) + 1)
                changed[at:at] = other[begin : begin + chance.randrange(64)]
            case 4:
                changed[at : at + 4] = chance.choice(
                    (b"\xff\xff\xff\xff", b"\0\0\0\0", b"\xff\xff\xff\x7f")
                )
            case _:
                changed[at : at + 8] = chance.choice(
                    (b"\0\0\0\0\0\0\xf8\x7f", b"\0\0\0\0\0\0\xf0\x7f")
                )
    return bytes(changed)


def _word(chance: Random, text: str, others: Sequence[bytes]) -> str:
    found = list(re.finditer(r"\w+", text))
    if not found:
        return text
    word = chance.choice(found)
    known = re.findall(r"\w+", _text(chance.choice(others))) or ["x"]
    new = chance.choice(
        (chance.choice(known), chance.choice(ODD_NUMBERS), chance.choice(ODD_TEXTS))
    )
    return text[: word.start()] + new + text[word.end() :]


def _number(chance: Random, text: str, others: Sequence[bytes]) -> str:
    found = list(re.finditer(r"[0-9]+", text))
    if not found:
        return _word(chance, text, others)
    number = chance.choice(found)
    return text[: number.start()] + chance.choice(ODD_NUMBERS) + text[number.end() :]


def _sign(chance: Random, text: str, _others: Sequence[bytes]) -> str:
    at = chance.randrange(len(text) + 1)
    return (
        text[:at]
        + chance.choice(SIGNS) * chance.choice((1, 1, 1, 2, 200))
        + text[at + chance.randrange(2) :]
    )


def _cut(chance: Random, text: str, _others: Sequence[bytes]) -> str:
    at = chance.randrange(len(text) + 1)
    return text[:at] + text[at + chance.randrange(1, 60) :]


def _end(chance: Random, text: str, _others: Sequence[bytes]) -> str:
    return text[: chance.randrange(len(text) + 1)]


def _lines(chance: Random, text: str, others: Sequence[bytes]) -> str:
    lines = text.split("\n")
    at, line = chance.randrange(len(lines)), chance.choice(lines)
    foreign = chance.choice(_text(chance.choice(others)).split("\n"))
    match chance.randrange(5):
        case 0:
            del lines[at]
        case 1:
            lines.insert(at, foreign)
        case 2:
            lines[at : at + 1] = [lines[at]] * chance.choice((2, 3, 30))
        case 3:
            lines[at] = " " * chance.randrange(6) + lines[at].lstrip()
        case _:
            lines[at] = line
    return "\n".join(lines)


def _piece(chance: Random, text: str, others: Sequence[bytes]) -> str:
    other = _text(chance.choice(others))
    begin, at = chance.randrange(len(other) + 1), chance.randrange(len(text) + 1)
    return text[:at] + other[begin : begin + chance.randrange(1, 80)] + text[at:]


def _ends_of_lines(chance: Random, text: str, _others: Sequence[bytes]) -> str:
    return text.replace("\n", chance.choice(("\r\n", "\r", "\n\n", "\u2028", "\x85", "")))


TEXTUAL: list[Mutation] = [
    _word,
    _word,
    _number,
    _number,
    _sign,
    _cut,
    _end,
    _lines,
    _lines,
    _piece,
    _ends_of_lines,
]


def _json(chance: Random, text: str, _others: Sequence[bytes]) -> str:
    try:
        tree = json.loads(text)
    except (ValueError, RecursionError):
        return text
    for _ in range(chance.choice((1, 1, 2, 3))):
        tree = _changed(chance, tree, 0)
    written = json.dumps(tree, indent=chance.choice((None, 1)), ensure_ascii=chance.random() < 0.5)
    return written.replace('"NUMBER"', chance.choice(ODD_NUMBERS))


def _yaml(chance: Random, text: str, _others: Sequence[bytes]) -> str:
    try:
        tree = yaml.load(text, LOADER)
        for _ in range(chance.choice((1, 1, 2, 3))):
            tree = _changed(chance, tree, 0)
        return str(yaml.dump(tree, Dumper=DUMPER, sort_keys=False, allow_unicode=True))
    except (yaml.YAMLError, ValueError, TypeError, RecursionError):
        return text


def _changed(chance: Random, tree: Any, depth: int) -> Any:
    """The tree with one node changed somewhere."""
    if isinstance(tree, dict) and tree and chance.random() < 0.85:
        return _changed_mapping(chance, tree, depth)
    if isinstance(tree, list) and tree and chance.random() < 0.85:
        return _changed_list(chance, tree, depth)
    return _other(chance, tree)


def _changed_mapping(chance: Random, tree: dict[Any, Any], depth: int) -> Any:
    key = chance.choice(list(tree))
    match chance.randrange(9):
        case 0:
            return {each: value for each, value in tree.items() if each != key}
        case 1:
            return {**tree, str(key) + chance.choice(ODD_TEXTS): tree[key]}
        case 2:
            return {**tree, key: tree[chance.choice(list(tree))]}
        case _:
            return {**tree, key: _changed(chance, tree[key], depth + 1)}


def _changed_list(chance: Random, tree: list[Any], depth: int) -> Any:
    at = chance.randrange(len(tree))
    match chance.randrange(8):
        case 0:
            return tree[:at] + tree[at + 1 :]
        case 1:
            return tree[: at + 1] + tree[at:]
        case 2:
            return [*tree[:at], chance.choice(tree), *tree[at + 1 :]]
        case _:
            return [*tree[:at], _changed(chance, tree[at], depth + 1), *tree[at + 1 :]]


def _other(chance: Random, value: Any) -> Any:
    """Another value in the place of a leaf or of a whole branch."""
    match chance.randrange(6):
        case 0:
            return chance.choice(ODD_VALUES)
        case 1:
            return "NUMBER"
        case 2:
            return chance.choice(ODD_TEXTS)
        case 3 if isinstance(value, str):
            return _word(chance, value, [value.encode("utf-8", "replace")])
        case 4:
            for _ in range(chance.randrange(DEEP)):
                value = [value]
            return value
        case _:
            return [value, value] if chance.random() < 0.5 else {"x": value}


def _xml(chance: Random, text: str, _others: Sequence[bytes]) -> str:
    try:
        root = ElementTree.fromstring(text)
    except (ElementTree.ParseError, ValueError):
        return text
    for _ in range(chance.choice((1, 1, 2, 3))):
        _change_element(chance, root)
    try:
        written = ElementTree.tostring(root, encoding="unicode")
    except (TypeError, ValueError, RecursionError):
        return text
    head = chance.choice(("", '<?xml version="1.0"?>\n', *XML_HEADS))
    return head + written


XML_HEADS = [
    f'<?xml version="1.0" encoding="{each}"?>\n'
    for each in ("utf-7", "latin-1", "x", "UTF-16", "cp037")
]
XML_HEADS += [
    '<!DOCTYPE a [<!ENTITY x "y"><!ENTITY z "&x;&x;&x;">]>\n',
    '<!DOCTYPE a SYSTEM "file:///etc/passwd">\n',
]


def _change_element(chance: Random, root: ElementTree.Element) -> None:
    every = list(root.iter())
    here, other = chance.choice(every), chance.choice(every)
    match chance.randrange(7):
        case 0 if len(here):
            here.remove(chance.choice(list(here)))
        case 1 if not any(each is here for each in other.iter()):
            here.append(other)
        case 2 if here.attrib:
            here.set(chance.choice(list(here.attrib)), chance.choice(ODD_NUMBERS + ODD_TEXTS[:3]))
        case 3 if here.attrib:
            del here.attrib[chance.choice(list(here.attrib))]
        case 4:
            here.text = chance.choice((chance.choice(ODD_NUMBERS), other.text, "", "a b c"))
        case 5:
            here.tag = other.tag
        case _:
            here.set(
                chance.choice(("id", "name", "n", "type")), chance.choice([*ODD_NUMBERS, "x", ""])
            )


TREES: dict[str, Mutation] = {"json": _json, "yaml": _yaml, "xml": _xml}
