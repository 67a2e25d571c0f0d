"""The parser tables of the grammar, made ahead, because reading them is ten times as fast.

They belong to one grammar and one version of the parser library. Where either is another one, the
tables are made in memory. After a change of the grammar, `python -c "import cellwright.kb.syntax;
cellwright.kb.syntax.write_tables()"` writes them anew.
"""

import hashlib
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import lark
from lark import Lark
from lark.grammar import Rule
from lark.lexer import TerminalDef

TABLES_FILE = Path(__file__).with_name("expressions.json")


def load_parser(grammar: Path, starts: Sequence[str]) -> Lark:
    """The parser of a grammar: from the tables that were made ahead, if they belong to it."""
    text = grammar.read_text("utf-8")
    tables = _ready_tables(text, starts)
    if tables is None:
        return build_parser(text, starts)
    parser: Lark = Lark._load_from_dict(tables["data"], tables["memo"])  # type: ignore[no-untyped-call]
    return parser


def build_parser(grammar: str, starts: Sequence[str]) -> Lark:
    """The parser of a grammar, made anew."""
    return Lark(grammar, parser="lalr", start=list(starts), maybe_placeholders=True)


def tables_text(grammar: str, starts: Sequence[str]) -> str:
    """The tables as text, with what they belong to."""
    data, memo = build_parser(grammar, starts).memo_serialize([TerminalDef, Rule])
    content = {"of": _tables_identity(grammar, starts), "data": data, "memo": memo}
    return json.dumps(content, sort_keys=True, separators=(",", ":")) + "\n"


def _ready_tables(grammar: str, starts: Sequence[str]) -> Any:
    """The tables that were made ahead; None if there are none for this grammar and this library."""
    try:
        content = json.loads(TABLES_FILE.read_bytes(), object_hook=_number_keys)
    except (OSError, ValueError):
        return None
    return content if content["of"] == _tables_identity(grammar, starts) else None


def _tables_identity(grammar: str, starts: Sequence[str]) -> str:
    parts = (lark.__version__, *starts, grammar.replace("\r\n", "\n"))
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()


def _number_keys(read: dict[str, Any]) -> dict[str | int, Any]:
    """A mapping whose keys that are numbers are numbers again: JSON only knows texts."""
    return {int(key) if key.isdecimal() else key: value for key, value in read.items()}
