"""What the server answers from the texts alone: without a process, as it does it after each
edit.
"""

import random
import shutil
from pathlib import Path
from typing import Any

import pytest

types = pytest.importorskip("lsprotocol.types")

from hypothesis import given  # noqa: E402
from hypothesis import strategies as st  # noqa: E402

from cellwright.engine.authoring.editor_view import quick_findings, thorough_findings  # noqa: E402
from cellwright.engine.faces.lsp.language_server import REQUEST_ANSWERS  # noqa: E402
from cellwright.engine.faces.lsp.live_diagnostics import LiveDiagnostics  # noqa: E402
from cellwright.engine.faces.lsp.open_files import (  # noqa: E402
    OpenFiles,
    TextLines,
    apply_change,
)
from cellwright.kb.targets import BUNDLED_DOMAINS  # noqa: E402

TEXTS = st.text(alphabet="ab é𝛼\n\r\t(\u2028\x0c", max_size=40)


@given(TEXTS, st.integers(0, 60))
def test_a_place_is_the_same_after_it_was_a_position(text: str, place: int) -> None:
    lines = TextLines(text)
    place = min(place, len(text))
    inside = text[place - 1 : place + 1] == "\r\n"
    assert inside or lines.offset(lines.position(place)) == place


@given(TEXTS, TEXTS, st.integers(0, 60), st.integers(0, 60))
def test_a_change_is_made_where_the_editor_means_it(
    text: str, new: str, one: int, other: int
) -> None:
    start, end = sorted((min(one, len(text)), min(other, len(text))))
    lines = TextLines(text)
    if "\r\n" in (text[start - 1 : start + 1], text[end - 1 : end + 1]):
        return
    change = types.TextDocumentContentChangePartial(lines.range(start, end), new)
    assert apply_change(text, change) == text[:start] + new + text[end:]


def asked(method: str, uri: str, line: int, column: int) -> Any:
    """A request at a place."""
    document = types.TextDocumentIdentifier(uri)
    position = types.Position(line, column)
    span = types.Range(types.Position(0, 0), position)
    special = {
        types.TEXT_DOCUMENT_REFERENCES: lambda: types.ReferenceParams(types.ReferenceContext(True), document, position),
        types.TEXT_DOCUMENT_RENAME: lambda: types.RenameParams(document, position, "fresh_name"),
        types.TEXT_DOCUMENT_DOCUMENT_SYMBOL: lambda: types.DocumentSymbolParams(document),
        types.TEXT_DOCUMENT_CODE_LENS: lambda: types.CodeLensParams(document),
        types.WORKSPACE_SYMBOL: lambda: types.WorkspaceSymbolParams("a"),
        types.TEXT_DOCUMENT_FORMATTING: lambda: types.DocumentFormattingParams(
            document, types.FormattingOptions(2, True)
        ),
        types.TEXT_DOCUMENT_CODE_ACTION: lambda: types.CodeActionParams(document, span, types.CodeActionContext([])),
    }  # fmt: skip
    return special.get(method, lambda: types.TextDocumentPositionParams(document, position))()


def opened(desk: OpenFiles, path: Path) -> str:
    desk.open(types.TextDocumentItem(path.as_uri(), "yaml", 0, path.read_text()))
    return path.as_uri()


def answer(desk: OpenFiles, method: str, uri: str, line: int, column: int) -> Any:
    """The answer of the server; that a name cannot be changed is one, too."""
    from pygls.exceptions import JsonRpcInvalidParams

    try:
        return REQUEST_ANSWERS[method][0](desk, asked(method, uri, line, column))
    except JsonRpcInvalidParams as refused:
        return str(refused)


PIECES = ["at(", "Item", ", ", "\n", "  "
"- ", "{", "}", "[", '"', ":", "not ", "#", "é", "𝛼", "\t", "pick", "  x: "
"y\n", "a..b", "%*"]  # fmt: skip
FILES = (
    "domain.yaml",
    "rules.lp",
    "problems/two.yaml",
    "faults.yaml",
    "cell.yaml",
    "contacts.yaml",
)


def survives(cell: Path, edits: int, seed: int) -> None:
    """Make random edits, ask at random, and compare with a server that has just begun."""
    chance, desk = random.Random(seed), OpenFiles()
    paths = [cell / each for each in FILES]
    for each in paths:
        opened(desk, each)
    for number in range(edits):
        path = chance.choice(paths)
        line, column = chance.randrange(220), chance.randrange(70)
        span = types.Range(
            types.Position(line, column), types.Position(line, column + chance.randrange(8))
        )
        text = "".join(chance.choices(PIECES, k=chance.randrange(3)))
        change: Any = types.TextDocumentContentChangePartial(span, text)
        if number % 400 == 399:
            change = types.TextDocumentContentChangeWholeDocument(path.read_text())
        document = types.VersionedTextDocumentIdentifier(number, path.as_uri())
        desk.change(types.DidChangeTextDocumentParams(document, [change]))
        line, column = chance.randrange(220), chance.randrange(60)
        method = chance.choice(list(REQUEST_ANSWERS))
        found = answer(desk, method, path.as_uri(), line, column)
        if number % 25 == 0:
            assert found == answer(fresh(desk), method, path.as_uri(), line, column)


def fresh(desk: OpenFiles) -> OpenFiles:
    """A desk with the same texts that has read nothing yet."""
    other = OpenFiles()
    for path, text in desk.texts.items():
        other.open(types.TextDocumentItem(desk.uri(path), "yaml", 0, text))
    return other


@pytest.fixture
def cell(tmp_path: Path) -> Path:
    return Path(shutil.copytree(BUNDLED_DOMAINS / "themse", tmp_path / "themse"))


def test_random_edits_are_survived_and_answers_are_those_of_a_new_server(cell: Path) -> None:
    survives(cell, 60, 3)


@pytest.mark.slow
def test_ten_thousand_random_edits_are_survived(cell: Path) -> None:
    survives(cell, 10_000, 5)


@pytest.mark.parametrize("method", list(REQUEST_ANSWERS))
def test_a_file_that_is_not_there_is_answered(method: str, tmp_path: Path) -> None:
    assert not getattr(
        answer(OpenFiles(), method, (tmp_path / "no.yaml").as_uri(), 3, 3), "items", None
    )


def test_findings_of_unsaved_texts_go_to_their_files_and_end_there(cell: Path) -> None:
    published: dict[str, Any] = {}
    desk = OpenFiles()
    findings = LiveDiagnostics(desk, lambda said: published.update({said.uri: said.diagnostics}))
    domain, rules = cell / "domain.yaml", cell / "rules.lp"
    uri = opened(desk, domain)
    line = rules.read_text().count("\n")
    text = rules.read_text() + "free_slot(D) :- part_off(D, drawer).\n"
    desk.open(types.TextDocumentItem(rules.as_uri(), "asp", 0, text))
    edited = (str(domain), str(rules))
    findings.show(str(domain), quick_findings(str(domain), edited, desk.texts), edited)
    (wrong,) = published[rules.as_uri()]
    assert (wrong.code, wrong.range.start.line) == ("K101", line)
    assert "did you mean 'part_of'?" in wrong.message
    assert published[uri] == []
    desk.open(types.TextDocumentItem(rules.as_uri(), "asp", 1, rules.read_text()))
    findings.show(str(domain), quick_findings(str(domain), edited, desk.texts), edited)
    assert published[rules.as_uri()] == []


def test_a_problem_far_from_its_domain_goes_with_it(tmp_path: Path) -> None:
    problem = tmp_path / "mine.yaml"
    problem.write_text('problem: mine\ndomain: themse\ngoals:\n  - sample_name(probe_1, "a")\n')
    desk = OpenFiles()
    uri = opened(desk, problem)
    found = answer(desk, types.TEXT_DOCUMENT_DEFINITION, uri, 3, 6)
    assert [each.uri for each in found] == [(BUNDLED_DOMAINS / "themse" / "domain.yaml").as_uri()]


@pytest.mark.slow
def test_a_whole_check_knows_examples_and_types(cell: Path) -> None:
    seen = thorough_findings(str(cell / "domain.yaml"), (), {})
    assert seen.complete
    assert [each for each in seen.findings if not each.warning and each.code != "K414"] == []
    assert seen.examples["heat"].startswith("heat(probe_")
    assert seen.parameters["pick"] == {"Item": "item", "Place": "place"}
    assert {str(cell / each) for each in FILES} <= set(seen.read)
