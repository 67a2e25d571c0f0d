"""Words and phrases are checked when their domain is loaded; a problem may have a command."""

from pathlib import Path

import pytest

from cellwright.kb.commands.ambiguous_phrases import unclear_words
from cellwright.kb.commands.phrase_patterns import (
    PatternError,
    PatternSlot,
    PatternWord,
    expand_pattern,
    read_pattern,
    readable_pattern,
)
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.loader import load, load_problem

DOMAIN = """\
domain: shelf
types: {box: object, place: object}
objects: {box: [box_1..3], place: [shelf, table]}
statics:
  heavy(box): {}
fluents:
  on(box, place): {}
events:
  weighed(box, time): {}
operators:
  move(Box, From, To):
    preconditions: on(Box, From)
    adds: on(Box, To)
    deletes: on(Box, From)
  weigh(Box, Time):
    preconditions: on(Box, table)
    adds: weighed(Box, Time)
    duration: Time
defaults:
  - on(Box, shelf)
commands:
  words: {box: [box, boxes]}
  phrases:
    - say: "put {B:box} (on|onto) {P:place}"
      goal: on(B, P)
"""
PHRASE = '    - say: "put {B:box} (on|onto) {P:place}"\n      goal: on(B, P)\n'


def load_with(folder: Path, phrase: str) -> list[str]:
    path = folder / "domain.yaml"
    path.write_text(DOMAIN.replace(PHRASE, phrase), "utf-8")
    with pytest.raises(InvalidInput) as raised:
        load(path)
    return [str(diagnostic).replace(f"{folder}/", "") for diagnostic in raised.value.diagnostics]


def spelled(say: str) -> list[str]:
    parts = expand_pattern(read_pattern(say))
    return [
        " ".join(p.text if isinstance(p, PatternWord) else f"<{p.type}>" for p in each)
        for each in parts
    ]


def test_a_pattern_is_the_sequences_that_it_allows() -> None:
    assert spelled("(put|lay) the {B:box} [down] (on|onto [top of]) {P:place}") == [
        "put <box> down on <place>",
        "put <box> down onto top of <place>",
        "put <box> down onto <place>",
        "put <box> on <place>",
        "put <box> onto top of <place>",
        "put <box> onto <place>",
        "lay <box> down on <place>",
        "lay <box> down onto top of <place>",
        "lay <box> down onto <place>",
        "lay <box> on <place>",
        "lay <box> onto top of <place>",
        "lay <box> onto <place>",
    ]


def test_slots_know_their_place() -> None:
    ((_, slot),) = expand_pattern(read_pattern("put {B:box}"))
    assert slot == PatternSlot("B", "box", 4)


@pytest.mark.parametrize(
    ("say", "offset", "message"),
    [
        ("put {b:box}", 4, "unexpected '{'"),
        ("put (on|onto {P:place}", 4, "this '(' is never closed"),
        ("put on) it", 6, "')' closes nothing"),
        ("[please] [now]", 0, "every part of this phrase is optional"),
        ("put, then", 3, "unexpected ','"),
    ],
)
def test_what_is_no_pattern_is_refused_at_its_place(say: str, offset: int, message: str) -> None:
    with pytest.raises(PatternError) as raised:
        read_pattern(say)
    assert (raised.value.offset, raised.value.message) == (offset, message)


def test_a_pattern_with_too_many_readings_is_refused() -> None:
    with pytest.raises(PatternError, match="too many alternatives"):
        read_pattern("go " + "[very] " * 11 + "far")


def test_people_are_shown_types_for_slots() -> None:
    assert readable_pattern("put {B:box} in depot {N:int}") == "put <box> in depot <number>"


@pytest.mark.parametrize(
    ("phrase", "code", "column", "message"),
    [
        ('    - say: "put {B:box}"\n      goal: onn(B, '
        'shelf)\n', "K101", 13, "unknown predicate 'onn'"),
        ('    - say: "put {B:bx}"\n      goal: on(B, shelf)\n', "K101", 17, "unknown type 'bx'"),
        ('    - say: "put {B:box}"\n      goal: on(B)\n', "K102", 13, "on takes 2 arguments"),
        ('    - say: "put {B:box}"\n      goal: on(shelf, '
        'table)\n', "K103", 16, "shelf is place, but on takes box here"),
        ('    - say: "put {B:box}"\n      goal: on(B, '
        'shlf)\n', "K101", 19, "unknown object 'shlf'"),
        ('    - say: "put {B:box}"\n      goal: on(C, '
        'shelf)\n', "K105", 16, "variable C is not a slot of the phrase"),
        ('    - say: "put {B:box}"\n      stage: on(B, '
        '_)\n', "K105", 20, "a stage cannot contain '_'"),
        ('    - say: "put {B:box}"\n      goal: '
        'heavy(B)\n', "K108", 13, "'heavy' is static; a goal is fluent or derived"),
        ('    - say: "put {B:box"\n      goal: on(B, shelf)\n', "K601", 17, "unexpected '{'"),
        ('    - say: "(put {B:box}|put it)"\n      goal: on(B, '
        'shelf)\n', "K601", 18, "slot B occurs 0 times in 'put it'"),
        ('    - say: "put {B:box} on r2-d2"\n      goal: on(B, '
        'shelf)\n', "K601", 28, "'r2-d2' is not a word that a sentence can contain"),
        ('    - say: "put {B:box}"\n      goal: on(B, '
        'shelf\n', "K106", 15, "this bracket is never closed"),
        ('    - say: "weigh {B:box}"\n      stage: "not weighed(B, '
        '5)"\n', "K107", 15, "a stage can only contain atoms"),
        ('    - say: "put {B:box}"\n      stage: weighed(B, 5) & on(B, '
        'shelf)\n', "K108", 14, "an event is no state"),
        ('    - say: "put {B:box}"\n      stage: on(B, shelf)\n      subject: '
        'C\n', "K105", 16, "'C' is no slot for an object"),
    ],
)  # fmt: skip
def test_a_wrong_phrase_is_reported_at_its_place(
    tmp_path: Path, phrase: str, code: str, column: int, message: str
) -> None:
    (said,) = load_with(tmp_path, phrase)
    first, source, caret, *_ = said.splitlines()
    assert f"error {code}: {message}" in first
    assert f":{column}:" in first
    assert caret.index("^") == column + 3
    assert source.strip() in phrase


def test_words_belong_to_types_and_objects(tmp_path: Path) -> None:
    path = tmp_path / "domain.yaml"
    path.write_text(
        DOMAIN.replace("words: {box: [box, boxes]}", "words: {bx: [box, boxes]}"), "utf-8"
    )
    with pytest.raises(InvalidInput) as raised:
        load(path)
    (found,) = raised.value.diagnostics
    assert (found.code, found.message, found.hint) == (
        "K101",
        "unknown type or object 'bx'",
        "did you mean 'box'?",
    )
    assert found.where.line == 22


def test_nouns_are_words_that_a_sentence_can_hold(tmp_path: Path) -> None:
    path = tmp_path / "domain.yaml"
    path.write_text(DOMAIN.replace("[box, boxes]", "[box, heavy box, 'box!', 5 min]"), "utf-8")
    with pytest.raises(InvalidInput) as raised:
        load(path)
    assert [(found.code, found.where.column) for found in raised.value.diagnostics] == [
        ("K606", 34),
        ("K606", 41),
    ]


def unclear(folder: Path, *changes: tuple[str, str]) -> list[str]:
    text = DOMAIN
    for old, new in changes:
        text = text.replace(old, new)
    (folder / "domain.yaml").write_text(text, "utf-8")
    return [each.message for each in unclear_words(load(folder / "domain.yaml").domain)]


@pytest.mark.parametrize(
    ("say", "goal", "said"),
    [
        ("[now] (lay|put) {X:box} on {P:place}", "on(X, shelf)", "put <box> on <place>"),
        ("put {X:box} on the table", "on(X, shelf)", "put <box> on table"),
        ("put {O:object} onto the shelf", "on(box_1, shelf)", "put box 2 onto shelf"),
        ("put {B:small_box} on {P:place}", "on(B, table)", "put <small_box> on <place>"),
        ("put crate on {P:place}", "on(box_1, P)", "put crate on <place>"),
        ("lay {X:box} on {P:place}", "on(X, shelf)", None),
        ("[now] (lay|put) {X:box} on {P:place}", "on(X, P)", None),
    ],
)
def test_sentences_of_two_phrases_are_pointed_at(
    tmp_path: Path, say: str, goal: str, said: str | None
) -> None:
    twin = f'{PHRASE}    - say: "{say}"\n      goal: {goal}\n'
    types = ("types: {box: object, ", "types: {box: object, small_box: box, ")
    messages = unclear(tmp_path, (PHRASE, twin), types, ("[box_1..3]", "[box_1..3, crate]"))
    expected = f"'{said}' also fits an earlier phrase, which takes precedence"
    assert messages == ([expected] if said else [])


def test_a_noun_of_two_types_is_pointed_at(tmp_path: Path) -> None:
    types = ("types: {box: object, ", "types: {box: object, small_box: box, ")
    words = ("words: {box: [box, boxes]}", "words: {box: [box, boxes], small_box: [box]}")
    assert unclear(tmp_path, types, words) == [
        "'box' means both box and small_box; a sentence means box"
    ]


def problem(folder: Path, more: str) -> str:
    (folder / "domain.yaml").write_text(DOMAIN, "utf-8")
    path = folder / "problem.yaml"
    path.write_text(f"problem: words\ndomain: shelf\n{more}", "utf-8")
    return str(path)


def test_a_problem_may_say_in_words_what_is_wanted(tmp_path: Path) -> None:
    found = load_problem(
        problem(tmp_path, "objects: {box: [box_9]}\ncommand: put boxes 1 and 9 on the table\n")
    )
    assert str(found.goal) == "on(box_1, table), on(box_9, table)"


def test_a_wrong_command_in_a_problem_is_reported_in_its_file(tmp_path: Path) -> None:
    path = problem(tmp_path, "command: >\n  put box 1\n  on the tabel\n")
    with pytest.raises(InvalidInput) as raised:
        load_problem(path)
    (found,) = raised.value.diagnostics
    assert (found.where.path, found.where.line, found.where.column) == (path, 5, 10)
    assert found.where.text == "  on the tabel"
    assert found.hint.startswith("did you mean 'table'?")


def test_a_problem_has_a_command_or_goals(tmp_path: Path) -> None:
    path = problem(tmp_path, "goals:\n  - on(box_1, table)\ncommand: put box 2 on the table\n")
    with pytest.raises(
        InvalidInput, match="a problem cannot have both a command and goals or a workflow"
    ):
        load_problem(path)


def test_an_event_as_a_stage_leaves_nothing_open(tmp_path: Path) -> None:
    path = problem(tmp_path, "workflow:\n  - stages: on(_, table), weighed(_, 5)\n")
    with pytest.raises(InvalidInput) as raised:
        load_problem(path)
    (found,) = raised.value.diagnostics
    assert (found.code, found.message) == ("K105", "an event that is a stage cannot contain '_'")
    assert found.where.column == 27
