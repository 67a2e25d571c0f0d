"""What a diagnostic prints: its place and a caret under the character, and nothing that a
terminal would obey.
"""

import unicodedata

from hypothesis import given
from hypothesis import strategies as st

from cellwright.kb.diagnostics import (
    DIAGNOSTIC_CODES,
    NOWHERE,
    Diagnostic,
    Source,
    printable_line,
    unknown_name,
)

texts = st.text(max_size=60) | st.text(
    st.sampled_from("a\x1b\x07\x9b\r\n\t\u202e\u2066日 "), max_size=30
)


def commands_a_terminal(character: str) -> bool:
    return unicodedata.category(character) == "Cc" or unicodedata.bidirectional(character) in (
        *("LRE", "RLE", "LRO", "RLO", "PDF"),
        *("LRI", "RLI", "FSI", "PDI"),
    )


@given(path=texts, line=texts, message=texts, hint=texts, column=st.integers(0, 70))
def test_nothing_that_a_file_holds_commands_the_terminal(
    path: str, line: str, message: str, hint: str, column: int
) -> None:
    printed = str(Diagnostic(Source(path, 3, column, line), "K101", message, hint))
    assert not [each for each in printed if commands_a_terminal(each) and each not in "\n\t"]
    assert len(printed.split("\n")) <= 4


@given(texts)
def test_what_is_shown_stays_as_it_is(text: str) -> None:
    assert printable_line(printable_line(text)) == printable_line(text)
    assert printable_line(text) == text or "\\u" in printable_line(text)


@given(
    st.text(st.characters(min_codepoint=32, max_codepoint=126), min_size=1, max_size=40), st.data()
)
def test_the_caret_stands_under_its_column(line: str, data: st.DataObject) -> None:
    column = data.draw(st.integers(1, len(line)))
    shown = Source("a.yaml", 1, column, line).excerpt()
    if line.strip():
        assert shown == [line, " " * (column - 1) + "^"]


def test_codes_are_a_letter_and_three_digits_in_order() -> None:
    assert list(DIAGNOSTIC_CODES) == sorted(DIAGNOSTIC_CODES)
    assert all(
        code[0] == "K" and code[1:].isdigit() and len(code) == 4 for code in DIAGNOSTIC_CODES
    )


def test_known_names_of_a_set_are_told_in_one_order() -> None:
    told = unknown_name("place", "", {"rim", "home", "lid", "flap"}, NOWHERE)
    assert told.hint == "known: flap, home, lid, rim"
