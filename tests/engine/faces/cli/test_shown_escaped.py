"""Nothing that a file says commands the terminal: control characters are shown, in text, JSON,
pictures and messages.
"""

import io
import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from cellwright.engine.faces.cli import app
from cellwright.engine.faces.cli.output import terminal_console
from cellwright.engine.formats.report.drawing import dot_graphs
from cellwright.kb.diagnostics import Diagnostic, Source, escape_controls
from cellwright.kb.model.plan_model import Plan, Step, StepId
from cellwright.kb.terms import Function, Text

EVIL = "a\x1b[31m\x9b1m\u202eb\x07\r\x7f\u2066"
COMMANDING = set("\x1b\x9b\u202e\x07\r\x7f\u2066\u2028\ud800")


def is_clean(text: str) -> bool:
    return not COMMANDING & set(text)


def test_commands_are_shown_and_everything_else_stays() -> None:
    assert escape_controls("\x1b[1m") == "\\u001b[1m"
    for each in ("plain", "ä ß 日本", "two\nlines\tand tabs", "a\r\nb", "\U0001f600"):
        assert escape_controls(each) == each


def test_json_stays_the_same_text() -> None:
    written = escape_controls(json.dumps({EVIL: "\u2028\x85"}, ensure_ascii=False))
    assert is_clean(written)
    assert json.loads(written) == {EVIL: "\u2028\x85"}


def test_a_console_shows_what_would_command_it() -> None:
    out = io.StringIO()
    terminal_console.make_console(file=out, width=200).print(f"x {EVIL} y", markup=False)
    assert is_clean(out.getvalue())
    assert "\\u001b" in out.getvalue()


def test_colours_of_our_own_stay() -> None:
    out = io.StringIO()
    terminal_console.make_console(file=out, force_terminal=True).print("[red]x[/]")
    assert "\x1b[31m" in out.getvalue()


def test_diagnostics_show_them() -> None:
    assert is_clean(str(Diagnostic(Source(EVIL, 1, 2, EVIL), "K001", EVIL, EVIL)))


def test_graphs_show_them() -> None:
    plan = Plan((Step(StepId(1), Function("act", (Text(EVIL),))),))
    drawn = dot_graphs.plan_dot(plan)
    assert is_clean(drawn)
    assert "\\\\u001b" in drawn


@pytest.fixture
def store(tmp_path: Path) -> str:
    step = {"id": 1, "operator": "go(a)", "duration": "1", "cost": "1"}
    macrop = {"macrop": f'"{EVIL}"', "domain": EVIL, "goals": [f'at("{EVIL}")'], "plan": [step]}
    macrop["macrop"] = f'go("{EVIL}")'
    (tmp_path / "m.json").write_text(json.dumps({"version": 1, "macrops": [macrop]}))
    told = CliRunner().invoke(
        app, ["macros", "import", str(tmp_path / "m.json"), "--store", str(tmp_path / "s.db")]
    )
    assert told.exit_code == 0, told.output
    return str(tmp_path / "s.db")


@pytest.mark.parametrize("words", [("list",), ("show", "1"), ("stats",)])
@pytest.mark.parametrize("form", ["text", "json"])
def test_what_a_library_holds_is_shown(store: str, words: tuple[str, ...], form: str) -> None:
    told = CliRunner().invoke(app, ["macros", *words, "--store", store, "--format", form])
    assert told.exit_code == 0, told.output
    assert is_clean(told.output)


def test_a_wrong_command_line_is_shown() -> None:
    assert is_clean(CliRunner().invoke(app, [EVIL]).output)
    assert is_clean(CliRunner().invoke(app, ["plan", EVIL]).output)
    assert is_clean(CliRunner().invoke(app, ["plan", "bulkhead", f"--{EVIL}"]).output)
