"""Answers show themselves: in a notebook as a picture and a text that cannot act, in JSON as
the command line writes them.
"""

import base64
import importlib.util
import json
import re
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest
from rich.text import Text
from typer.testing import CliRunner

import cellwright
from cellwright.engine.faces.cli import app
from tests.places import TOP

PICTURES = {
    "plan": lambda: cellwright.plan("bulkhead/one_point"),
    "schedule": lambda: cellwright.schedule("bulkhead/one_point"),
    "sequence": lambda: cellwright.sequence("bulkhead/twelve_points"),
    "tree": lambda: cellwright.decision_tree("bulkhead", "no_echo"),
    "cell": lambda: cellwright.cell("handey"),
    "states": lambda: cellwright.states("themse"),
}
COMMANDS = {
    "plan": ("plan", "bulkhead/one_point"),
    "schedule": ("schedule", "bulkhead/one_point"),
    "sequence": ("sequence", "bulkhead/twelve_points"),
    "tree": ("diagnose", "bulkhead", "--exception", "no_echo", "--tree"),
    "cell": ("cell", "show", "handey"),
    "states": ("states", "themse"),
}


@pytest.mark.parametrize("name", sorted(PICTURES))
def test_an_answer_is_drawn_and_told_as_by_the_command_line(name: str) -> None:
    answer = PICTURES[name]()
    drawn = answer._repr_svg_()
    assert drawn == CliRunner().invoke(app, [*COMMANDS[name], "--format", "svg"]).stdout
    assert ElementTree.fromstring(drawn).tag.endswith("svg")
    told = CliRunner().invoke(app, [*COMMANDS[name], "--format", "json"]).stdout
    assert json.loads(answer.json()) == json.loads(told)
    page = answer._repr_html_()
    (source,) = re.findall(r'src="data:image/svg\+xml;base64,([^"]+)"', page)
    assert base64.b64decode(source).decode() == drawn
    assert ElementTree.fromstring(page) is not None


def test_no_plan_is_an_answer_without_a_picture() -> None:
    answer = cellwright.plan("bulkhead/tool_missing")
    assert (answer.status, answer.plan, answer._repr_svg_()) == ("infeasible", None, None)
    assert "<img" not in answer._repr_html_()
    assert "No plan exists" in str(answer)


def test_names_in_files_cannot_act_on_a_page_or_a_terminal() -> None:
    told = cellwright.Told(
        "<script>alert(1)</script>\x1b[2J", "<b>", lambda _: {}, lambda each: Text(each)
    )
    assert "<script" not in told._repr_html_()
    assert "\x1b" not in str(told)
    assert "<b>" not in told._repr_html_()


def test_a_limit_of_time_gives_the_best_so_far_or_says_so() -> None:
    """The time is over while the problem is grounded, or, where it has been, in the search."""

    def answer(seconds: float | None) -> str:
        command = "heat probe 1 for 15 min and store it again"
        try:
            return cellwright.plan("themse", command=command, seconds=seconds).status
        except TimeoutError as error:
            return str(error)

    assert answer(0) in ("stopped", "no answer within 0 s: give more seconds, or ask for less")
    assert answer(None) in ("found", "optimal")
    assert answer(0) == "stopped"


def test_wrong_input_is_told_as_by_the_command_line() -> None:
    with pytest.raises(cellwright.InvalidInput, match="did you mean 'bulkhead'"):
        cellwright.plan("bulkheat")
    with pytest.raises(cellwright.InvalidInput, match="did you mean 'forward'"):
        cellwright.plan("bulkhead/one_point", strategy="foward")  # type: ignore[arg-type]
    with pytest.raises(cellwright.InvalidInput, match="give one of ask, outcomes and hidden"):
        cellwright.diagnose("bulkhead", "no_echo")
    with pytest.raises(cellwright.InvalidInput, match="there is no plan"):
        cellwright.why(cellwright.plan("bulkhead/tool_missing"), 1)


def test_an_answer_serves_as_a_plan_file(tmp_path: Path) -> None:
    answer = cellwright.plan("bulkhead/one_point")
    file = tmp_path / "plan.json"
    file.write_text(answer.json())
    assert cellwright.validate(file)
    assert cellwright.validate(answer)
    assert cellwright.schedule(answer).starts == cellwright.schedule(file).starts
    assert str(cellwright.why(answer, 2)) == str(cellwright.why(file, 2))
    assert not cellwright.validate(answer, "bulkhead/twelve_points")


SHOWN = """
import sys
sys.path.insert(0, {top!r})
import cellwright
from IPython.core.formatters import DisplayFormatter
answer = cellwright.plan("bulkhead/one_point")
found, _ = DisplayFormatter().format(answer)
print(sorted(found))
assert found["image/svg+xml"] == answer.svg()
assert "<img" in found["text/html"]
found, _ = DisplayFormatter().format(cellwright.plan("bulkhead/tool_missing"))
print(sorted(found))
"""


def test_a_notebook_shows_picture_and_text(tmp_path: Path) -> None:
    """In a fresh interpreter, through IPython's own formatter if IPython is there, else by the
    methods that it calls.
    """
    code = SHOWN
    if importlib.util.find_spec("IPython") is None:
        stub = (
            "class DisplayFormatter:\n    def format(self, each):\n        kinds = "
            "{'text/html': each._repr_html_(), 'image/svg+xml': each._repr_svg_(), "
            "'text/plain': repr(each)}\n        return {kind: shown for kind, shown in "
            "kinds.items() if shown is not None}, {}\n"
        )
        code = code.replace("from IPython.core.formatters import DisplayFormatter\n", stub)
    ran = subprocess.run(
        [sys.executable, "-c", code.replace("{top!r}", repr(str(TOP)))],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert ran.returncode == 0, ran.stderr
    assert ran.stdout.splitlines() == [
        "['image/svg+xml', 'text/html', 'text/plain']",
        "['text/html', 'text/plain']",
    ]
