"""Whatever is in a file, the loader returns or raises `InvalidInput`, and soon: mutated,
generated and garbled files.
"""

import re
import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from cellwright.kb.asp import AspError, ground_term
from cellwright.kb.asp.statements import read_statements
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.files import File
from cellwright.kb.loader import load
from cellwright.kb.loader.cell import load_cell
from cellwright.kb.loader.contacts import load_contacts
from cellwright.kb.loader.fault_base import load_faults
from cellwright.kb.syntax import GRAMMAR_STARTS, ExpressionError, parse_expression

TOP = Path(__file__).parents[2]
CELLS = [
    TOP / "domains" / "themse",
    TOP / "domains" / "bulkhead",
    TOP / "engine" / "authoring" / "starter" / "cell",
]
CELLS += sorted(path.parent for path in (TOP / "tests" / "domains").glob("*/domain.yaml"))
FILES = [
    path for cell in CELLS for path in sorted(cell.rglob("*")) if path.suffix in (".yaml", ".lp")
]
FILES = [path for path in FILES if "golden" not in path.parts]
SECONDS = 5.0

quick = settings(
    max_examples=10, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck)
)
slow = settings(max_examples=300, deadline=None, suppress_health_check=list(HealthCheck))

SPICE = [
    *(
        "(",
        ")",
        "[",
        "]",
        "{",
        "}",
        ",",
        ";",
        ":",
        ": ",
        ".",
        "..",
        "|",
        "'",
        '"',
        "#",
        " #",
        "- ",
        "? ",
        "\n",
        "\t",
    ),
    *(
        "_",
        "X",
        "not ",
        "not(",
        ":-",
        "=",
        "!=",
        "<",
        "+1",
        "-1",
        "*",
        "\\",
        "@f(1)",
        "&a ",
        "*a",
        "!x ",
        "<<: ",
        "%",
    ),
    *(
        "#count{X : p(X)}",
        "#script (python)",
        '#include "/etc/passwd".',
        "#const a=1.",
        "#show.",
        "..1000000000",
    ),
    *(
        "0",
        "99999999999",
        "2.5",
        "1e5",
        "0x1f",
        "12:30",
        "15 min",
        "on",
        "null",
        "~",
        "true",
        "int",
        "object",
        "term",
    ),
    *(
        "\0",
        "\x7f",
        "\x85",
        "\u2028",
        "\ufeff",
        "\U0001f600",
        "é",
        "---\n",
        "| \n",
        ">-\n",
        "p" * 300,
        "(" * 200,
    ),
]
pieces = st.sampled_from(SPICE)
words = st.sampled_from(
    sorted({word for file in FILES for word in re.findall(r"\w+", file.read_text("utf-8"))})
)


@contextmanager
def answered_soon() -> Iterator[None]:
    started = time.process_time()
    said = "sound"
    try:
        yield
    except InvalidInput as error:
        said = str(error)
    assert said
    assert time.process_time() - started < SECONDS


@st.composite
def mutated(draw: st.DrawFn, text: str) -> str:
    for _ in range(draw(st.integers(1, 5))):
        text = draw(MUTATIONS)(draw, text)
    return text


def _insert(draw: st.DrawFn, text: str) -> str:
    at = draw(st.integers(0, len(text)))
    return text[:at] + draw(pieces) + text[at:]


def _cut(draw: st.DrawFn, text: str) -> str:
    at = draw(st.integers(0, len(text)))
    return text[:at] + text[at + draw(st.integers(1, 40)) :]


def _swap_word(draw: st.DrawFn, text: str) -> str:
    found = list(re.finditer(r"\w+", text))
    if not found:
        return text
    word = draw(st.sampled_from(found))
    return text[: word.start()] + draw(words | pieces) + text[word.end() :]


def _move_line(draw: st.DrawFn, text: str) -> str:
    lines = text.split("\n")
    line = lines.pop(draw(st.integers(0, len(lines) - 1)))
    lines.insert(draw(st.integers(0, len(lines))), line)
    return "\n".join(lines)


def _repeat_line(draw: st.DrawFn, text: str) -> str:
    lines = text.split("\n")
    at = draw(st.integers(0, len(lines) - 1))
    return "\n".join([*lines[:at], *[lines[at]] * draw(st.integers(2, 4)), *lines[at + 1 :]])


def _indent(draw: st.DrawFn, text: str) -> str:
    lines = text.split("\n")
    at = draw(st.integers(0, len(lines) - 1))
    lines[at] = (
        " " * draw(st.integers(1, 4)) + lines[at] if draw(st.booleans()) else lines[at].lstrip()
    )
    return "\n".join(lines)


MUTATIONS = st.sampled_from([_insert, _cut, _swap_word, _move_line, _repeat_line, _indent])


def mutations_are_answered(data: st.DataObject, folder: Path) -> None:
    original = data.draw(st.sampled_from(FILES))
    cell = next(cell for cell in CELLS if original.is_relative_to(cell))
    copy = folder / cell.name
    shutil.copytree(cell, copy, dirs_exist_ok=True)
    target = copy / original.relative_to(cell)
    target.write_text(data.draw(mutated(original.read_text("utf-8"))), "utf-8")
    problems = sorted((copy / "problems").glob("*.yaml"))
    asked = (
        target
        if target in problems
        else data.draw(st.sampled_from([copy / "domain.yaml", *problems]))
    )
    with answered_soon():
        load(asked)


atoms = st.builds(
    "{}({})".format, words, st.lists(words | st.sampled_from("XYZ_"), max_size=3).map(", ".join)
)
garbled = st.lists(atoms | pieces | words, max_size=12).map(" ".join)
values = st.recursive(
    st.none() | st.integers() | st.booleans() | atoms | garbled | words,
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(atoms | words | garbled, inner, max_size=3)
    ),
    max_leaves=8,
)
KEYS = [
    "types",
    "functions",
    "objects",
    "statics",
    "derived",
    "fluents",
    "events",
    "defaults",
    "operators",
]
KEYS += [
    "deductive_operators",
    "commands",
    "include",
    "units",
    "initial",
    "goals",
    "workflow",
    "complete",
    "command",
]
FIELDS = [
    "types",
    "where",
    "preconditions",
    "adds",
    "deletes",
    "effects",
    "resources",
    "duration",
    "cost",
    "command",
]
FIELDS += [
    "when",
    "implies",
    "denies",
    "stages",
    "for",
    "after",
    "say",
    "goal",
    "stage",
    "name",
    "subject",
]
shaped = (
    values
    | st.dictionaries(
        atoms | words,
        st.just({}) | st.dictionaries(st.sampled_from(FIELDS), values, max_size=4),
        max_size=3,
    )
    | st.lists(st.dictionaries(st.sampled_from(FIELDS), atoms | values, max_size=4), max_size=3)
)
contents = st.dictionaries(st.sampled_from(KEYS), shaped, max_size=6)


def generated_yaml_is_answered(data: st.DataObject, folder: Path) -> None:
    content = {"domain": "cell", **data.draw(contents)}
    text = yaml.safe_dump(content, sort_keys=False, default_flow_style=data.draw(st.booleans()))
    (folder / "domain.yaml").write_text(text, "utf-8")
    with answered_soon():
        load(folder / "domain.yaml")
    content = {
        "problem": "all",
        "domain": data.draw(st.sampled_from(["themse", "bulkhead"])),
        **data.draw(contents),
    }
    (folder / "problem.yaml").write_text(yaml.safe_dump(content), "utf-8")
    with answered_soon():
        load(folder / "problem.yaml")


bodies = st.lists(atoms | atoms.map("not {}".format) | garbled, max_size=4).map(", ".join)
rules = (
    st.builds("{} :- {}.".format, atoms | garbled | st.just(""), bodies)
    | atoms.map("{}.".format)
    | garbled
)
programs = st.lists(rules, max_size=6).map("\n".join)


def generated_rules_are_answered(data: st.DataObject, folder: Path) -> None:
    cell = folder / "bulkhead"
    shutil.copytree(CELLS[1], cell, dirs_exist_ok=True)
    (cell / "rules.lp").write_text(data.draw(programs), "utf-8")
    with answered_soon():
        load(cell / "problems" / "one_point.yaml")


def garbled_expressions_are_answered(data: st.DataObject, _: Path) -> None:
    text = data.draw(garbled | st.text(max_size=40))
    for start in GRAMMAR_STARTS:
        with answered_soon():
            offset = 0
            try:
                parse_expression(start, text)
            except ExpressionError as error:
                offset = error.offset
            assert 0 <= offset <= len(text)
    with answered_soon():
        with suppress(AspError):
            ground_term(text)
        with suppress(AspError):
            list(read_statements(text, File.of("rules.lp", text).line))


CLAIMS = [
    mutations_are_answered,
    generated_yaml_is_answered,
    generated_rules_are_answered,
    garbled_expressions_are_answered,
]
claims = pytest.mark.parametrize("claim", CLAIMS, ids=lambda claim: claim.__name__)


@claims
def test_files(claim: Callable[[st.DataObject, Path], None], tmp_path: Path) -> None:
    quick(given(st.data())(lambda data: claim(data, tmp_path)))()


@pytest.mark.slow
@claims
def test_many_more_files(claim: Callable[[st.DataObject, Path], None], tmp_path: Path) -> None:
    slow(given(st.data())(lambda data: claim(data, tmp_path)))()


@pytest.mark.parametrize("file", FILES, ids=lambda file: f"{file.parent.name}/{file.name}")
def test_a_file_cut_short_is_answered(file: Path, tmp_path: Path) -> None:
    cell = next(cell for cell in CELLS if file.is_relative_to(cell))
    shutil.copytree(cell, tmp_path, dirs_exist_ok=True)
    data = file.read_bytes()
    cut = tmp_path / file.relative_to(cell)
    read = READERS.get(file.name, lambda domain: load(cut if "problems" in cut.parts else domain))
    for length in range(0, len(data), max(1, len(data) // 4)):
        cut.write_bytes(data[:length])
        with answered_soon():
            read(tmp_path / "domain.yaml")


READERS: dict[str, Callable[[Path], object]] = {
    "cell.yaml": lambda domain: load_cell(domain.with_name("cell.yaml")),
    "contacts.yaml": load_contacts,
    "faults.yaml": load_faults,
}
