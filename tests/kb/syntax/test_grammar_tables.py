"""The tables of the grammar that are made ahead are those of the grammar."""

import json
from pathlib import Path

import pytest

from cellwright.kb.syntax import GRAMMAR_FILE, GRAMMAR_STARTS, grammar_tables
from cellwright.kb.syntax.grammar_tables import TABLES_FILE, build_parser, load_parser

TEXTS = {
    "conditions": 'at(A, rack_point(Tool)), not held(T) | free(A), X < 3 + 2 * Y, name("a, b")',
    "header": "pick_up(Tool, Arm)",
    "body": "weight(T, W), W <= 1.5, 2 < #count{ X : p(X) }",
    "clauses": "p(X), q(X); r",
    "stages": "a & b, c",
    "signature": "travel(place, place)",
    "term": "-3 * f(X) + 10 min",
}


@pytest.fixture(scope="module")
def text() -> str:
    return GRAMMAR_FILE.read_text("utf-8")


def test_the_tables_are_up_to_date(text: str) -> None:
    assert grammar_tables._ready_tables(text, GRAMMAR_STARTS) is not None, (
        "write them anew, as kb/syntax/grammar_tables.py says"
    )


def test_the_tables_have_all_rules_of_the_grammar(text: str) -> None:
    made, fresh = load_parser(GRAMMAR_FILE, GRAMMAR_STARTS), build_parser(text, GRAMMAR_STARTS)
    assert sorted(map(str, made.rules)) == sorted(map(str, fresh.rules))
    assert sorted(map(str, made.terminals)) == sorted(map(str, fresh.terminals))


@pytest.mark.parametrize("start", sorted(TEXTS))
def test_both_read_the_same(text: str, start: str) -> None:
    made, fresh = load_parser(GRAMMAR_FILE, GRAMMAR_STARTS), build_parser(text, GRAMMAR_STARTS)
    assert made.parse(TEXTS[start], start) == fresh.parse(TEXTS[start], start)


def test_tables_of_another_grammar_or_library_are_not_used(
    text: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert grammar_tables._ready_tables(text + "\n", GRAMMAR_STARTS) is None
    assert grammar_tables._ready_tables(text, GRAMMAR_STARTS[:-1]) is None
    monkeypatch.setattr(grammar_tables.lark, "__version__", "0")
    assert grammar_tables._ready_tables(text, GRAMMAR_STARTS) is None


def test_tables_that_cannot_be_read_are_made_in_memory(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(grammar_tables, "TABLES_FILE", tmp_path / "missing.json")
    assert load_parser(GRAMMAR_FILE, GRAMMAR_STARTS).parse("a, b", "atoms").data == "atoms"


def test_the_file_is_plain_json() -> None:
    assert set(json.loads(TABLES_FILE.read_text("utf-8"))) == {"of", "data", "memo"}
