"""The usual form of files: comments and meaning stay, and what has it keeps it."""

import random
import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cellwright.kb.asp.statements import statement_texts
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.editing.expression_tokens import tokens_of
from cellwright.kb.editing.file_layout import (
    format_file,
    same_but_for_spaces,
    space_expression,
    spaced_rules,
)
from cellwright.kb.files import read_unsaved
from cellwright.kb.loader import load, problem_files
from cellwright.kb.targets import BUNDLED_DOMAINS

FILES = [
    path
    for pattern in ("*/*.yaml", "*/*.lp", "*/problems/*.yaml")
    for path in sorted(BUNDLED_DOMAINS.glob(pattern))
    if path.stat().st_size < 40_000
]


@pytest.mark.parametrize("path", FILES, ids=lambda path: "/".join(path.parts[-2:]))
def test_the_files_that_we_ship_have_it(path: Path) -> None:
    assert format_file(str(path), path.read_text()) == path.read_text()


def mangled(text: str, chance: random.Random) -> str:
    """A YAML text with other spaces: deeper levels, blanks at ends of lines, blank lines,
    spaces in brackets.
    """
    lines = []
    deeper = chance.choice([1, 2])
    for line in text.splitlines():
        indent = len(line) - len(line.lstrip(" "))
        code = line.lstrip(" ")
        if deeper == 2 and code.startswith("- "):
            code = "-   " + code[2:]
        if (
            not code.startswith(("goal", "stage", "-"))
            and chance.random() < 0.5
            and not set("{\"'") & set(code)
        ):
            said, mark, comment = code.partition("#")
            code = re.sub(r"\((?=[A-Za-z])", "( ", said) + mark + comment
        lines.append(" " * indent * deeper + code + " " * chance.randrange(3))
        lines += [""] * chance.choice([0, 0, 0, 2])
    return "\n".join(lines)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("name", ["themse", "bulkhead", "centrifuge", "handey"])
def test_a_domain_in_another_form_means_the_same_and_gets_the_usual_one(
    name: str, seed: int
) -> None:
    path = BUNDLED_DOMAINS / name / "domain.yaml"
    text = path.read_text()
    other = mangled(text, random.Random(seed))
    back = format_file(str(path), other)
    unblanked = [line for line in back.splitlines() if line]
    assert [line.split("#")[0].rstrip() for line in unblanked] == [
        line.split("#")[0].rstrip() for line in text.splitlines() if line
    ]
    before = load(path).domain
    with read_unsaved({str(path): other}):
        assert load(path).domain == before
    with read_unsaved({str(path): back}):
        assert load(path).domain == before
    assert comments(back) == comments(text)


def comments(text: str) -> list[str]:
    return [found.strip() for found in re.findall(r"(?:^|\s)(#.*)$", text, re.MULTILINE)]


@pytest.mark.parametrize("name", ["themse", "bulkhead", "centrifuge"])
def test_a_formatted_domain_is_the_same_model(name: str) -> None:
    path = BUNDLED_DOMAINS / name / "domain.yaml"
    texts = {
        str(each): format_file(str(each), each.read_text()) for each in [path, *problem_files(path)]
    }
    with read_unsaved(texts):
        again = [load(path).domain, *(load(each).problem for each in problem_files(path))]
    assert again == [load(path).domain, *(load(each).problem for each in problem_files(path))]


EXAMPLE = """\
domain:   d


types:
      place: object   # where things are
      # what is held
      item:  object
fluents: {"at( item,place )": {}}
deductive_operators:
- when: at(Item,Place)   # one
  denies: at(Item,Other),Other!=Place;free( Place )
-   when: not at(Item, Place)
    implies: >
      free(Place),
        more

operators:
    go( From,To ):
            adds: at(From,To)
            command: {stream: go, reply: done}
"""
USUAL = """\
domain:   d

types:
  place: object       # where things are
  # what is held
  item:  object
fluents: {"at(item, place)": {}}
deductive_operators:
  - when: at(Item, Place)  # one
    denies: at(Item, Other), Other != Place; free(Place)
  - when: not at(Item, Place)
    implies: >
      free(Place),
        more

operators:
  go(From, To):
    adds: at(From, To)
    command: {stream: go, reply: done}
"""


def test_an_example() -> None:
    assert format_file("domain.yaml", EXAMPLE) == USUAL
    assert format_file("domain.yaml", USUAL) == USUAL
    assert format_file("domain.yaml", EXAMPLE.replace("\n", "\r\n")) == USUAL


def test_rules_get_their_spaces_and_keep_their_columns() -> None:
    text = (
        "p( X,Y ):-q(X) ,not r( Y ).  % why\n\n\n\nlong(X)   :- p(X,1..3),X!=2 ;  s.\n%* a\n  b "
        "*%\nf(a).  f(b)."
    )
    made = spaced_rules(text)
    assert made == (
        "p(X, Y) :- q(X), not r(Y).  % why\n\nlong(X)   :- p(X, 1..3), X != 2;  s.\n%* a\n  b "
        "*%\nf(a).  f(b).\n"
    )
    assert statement_texts(made) == statement_texts(text)
    assert spaced_rules(made) == made


@pytest.mark.parametrize(
    "text", ["operators: [", "domain: d\n\tx: y\n", "a: b\na: c\n", "x: &a b\n"]
)
def test_a_broken_text_is_refused(text: str) -> None:
    with pytest.raises(InvalidInput):
        format_file("domain.yaml", text)


def test_broken_rules_are_refused() -> None:
    with pytest.raises(InvalidInput):
        format_file("rules.lp", "p(X) :- q(X")


PARTS = st.sampled_from(
    ["at", "Item", "(", ")", ",", ";", " ", " "
    " ", "not ", "=", "!=", "1", "..", "+", "-", '"a b"', "#count", "{", "}", ":", "|", "&", "_"]
)  # fmt: skip


@given(st.lists(PARTS, max_size=25).map("".join))
def test_spaces_never_change_the_tokens_of_an_expression(text: str) -> None:
    made = space_expression(text)
    assert same_but_for_spaces(text, made)
    assert space_expression(made) == made


@given(st.text(alphabet="ab(X), .:-%\"{}#'1\n\t;!=", max_size=60))
def test_spaces_never_change_the_tokens_of_rules(text: str) -> None:
    made = spaced_rules(text)
    assert [each.text.rstrip() for each in tokens_of(made, True)] == [
        each.text.rstrip() for each in tokens_of(text, True)
    ]
    assert spaced_rules(made) == made


def test_a_device_may_be_filled_in_inside_brackets_of_yaml() -> None:
    written = (
        "device: x\nobjects: {unit:   ${prefix}arm}\noperators:\n   $go(P):  {adds: "
        "'at(P,${prefix}b)', cost: ${time}}\n"
    )
    assert format_file("device.yaml", written) == (
        "device: x\nobjects: {unit:   ${prefix}arm}\noperators:\n  $go(P):  {adds: 'at(P, "
        "${prefix}b)', cost: ${time}}\n"
    )
    with pytest.raises(InvalidInput, match="K002"):
        format_file("device.yaml", "device: x\nobjects: {unit: ${prefix}arm\n")


def test_rules_of_a_device_keep_what_is_filled_in() -> None:
    text = (
        "usual_capacity($name,$capacity).\naccessible(D):-part_of(D,${prefix}clamp),D!=$name .  "
        "% as it is\n"
    )
    made = format_file("devices/shaker/rules.lp", text)
    assert made.splitlines() == [
        "usual_capacity($name, $capacity).",
        "accessible(D) :- part_of(D, ${prefix}clamp), D != $name.  % as it is",
    ]
    assert format_file("devices/shaker/rules.lp", made) == made
