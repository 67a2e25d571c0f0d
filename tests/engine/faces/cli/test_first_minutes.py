"""The first five minutes: help by purpose on 80 columns, completion, progress of slow commands,
a home that nobody may write.
"""

import os
import re
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import typer
from typer.testing import CliRunner

from cellwright.engine.authoring.starter import create_domain
from cellwright.engine.faces.cli import app
from cellwright.engine.faces.cli.options import shared_options
from cellwright.engine.faces.cli.process import progress_line
from cellwright.engine.faces.cli.typer_application import OPTIONS_FOR, first_sentence
from cellwright.engine.faces.cli.verb_table import VERBS, VERBS_FOR
from tests.places import TOP

PROGRAM = typer.main.get_command(app)


def commands(
    group: Any = PROGRAM, words: tuple[str, ...] = ()
) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Every command with its words, groups too."""
    yield words, group
    for name in sorted(getattr(group, "commands", {})):
        yield from commands(group.commands[name], (*words, name))


EVERY = dict(commands())


def printed(*words: str) -> str:
    return CliRunner(env={"COLUMNS": "80"}).invoke(app, list(words)).stdout


def test_every_verb_stands_under_one_heading() -> None:
    listed = [verb for verbs in VERBS_FOR.values() for verb in verbs]
    assert sorted(listed) == sorted(VERBS)


def test_every_option_under_a_heading_is_there() -> None:
    known = {
        option for command in EVERY.values() for each in command.params for option in each.opts
    }
    assert {option for options in OPTIONS_FOR.values() for option in options} <= known


def test_help_lists_verbs_by_purpose_in_their_order() -> None:
    page = printed("--help")
    places = [page.index(f"─ {heading} ─") for heading in VERBS_FOR]
    assert places == sorted(places)
    assert "Options" in page


def test_help_is_asked_for_in_several_ways() -> None:
    assert printed("-h") == printed("--help") == printed("help")
    assert printed("plan", "-h") == printed("plan", "--help") == printed("help", "plan")
    assert printed("motion", "plan", "--help") == printed("help", "motion", "plan")


@pytest.mark.parametrize("words", [each for each in EVERY if len(each) < 2], ids=" ".join)
def test_help_fits_on_80_columns(words: tuple[str, ...]) -> None:
    page = printed(*words, "--help")
    assert page
    assert [line for line in page.splitlines() if len(line) > 80] == []


def test_arguments_stand_in_capitals() -> None:
    wrong = {
        " ".join(words): each.metavar
        for words, command in EVERY.items()
        for each in command.params
        if each.param_type_name == "argument" and each.metavar.upper() != each.metavar
    }
    assert wrong == {}


def test_a_list_of_commands_tells_one_sentence_of_each() -> None:
    assert first_sentence("Go on with RUN: ask the driver.\nAnd more.") == "Go on with RUN"
    assert first_sentence("Write a.yaml; then stop.") == "Write a.yaml"


def test_the_table_of_verbs_says_what_the_help_of_each_verb_says() -> None:
    for name, verb in VERBS.items():
        command = PROGRAM.commands[name]  # type: ignore[attr-defined]
        assert verb.summary == first_sentence(command.help or "")


def test_the_page_of_all_verbs_loads_none_of_them() -> None:
    code = "import atexit, sys; from cellwright.engine.faces.cli import main"
    code += "; atexit.register(lambda: print(*sys.modules, file=sys.stderr)); main()"
    ran = subprocess.run(
        [sys.executable, "-c", code, "--help"], capture_output=True, text=True, check=True
    )
    assert not [name for name in ran.stderr.split() if ".verbs." in name]


def test_what_is_said_of_getting_less_is_an_option_of_that_command() -> None:
    for verb, (_, less) in progress_line.DOING.items():
        known = {option for each in EVERY[tuple(verb.split())].params for option in each.opts}
        if not known - {"--help"}:
            continue
        for option in re.findall(r"--[a-z-]+", less):
            assert option in known, (verb, option)


def test_targets_are_completed_with_names_and_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "bulk.yaml").touch()
    (tmp_path / "bulk.txt").touch()
    (tmp_path / "bulks").mkdir()
    assert set(shared_options.complete_targets("bulk")) >= {
        "bulkhead",
        "bulkhead/one_point",
        "bulk.yaml",
        "bulks/",
    }
    assert "bulk.txt" not in shared_options.complete_targets("bulk")
    assert shared_options.complete_targets("bulkhead/tw") == [
        "bulkhead/twelve_points",
        "bulkhead/two_contacts",
    ]
    assert shared_options.complete_targets("nowhere/") == []
    assert shared_options.complete_devices("furnace,bal") == ["furnace,balance"]
    assert "handey/five" in shared_options.complete_scenes("handey/f")


def test_runs_are_completed_from_the_journal(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    assert shared_options.complete_runs("o") == []
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "file"))
    (tmp_path / "file").touch()
    assert shared_options.complete_runs("o") == []


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_a_shell_completes_problems(shell: str, tmp_path: Path) -> None:
    environment = {
        **os.environ,
        "PYTHONPATH": str(TOP),
        "_CELLWRIGHT_COMPLETE": f"complete_{shell}",
        "COMP_WORDS": "cellwright plan bulkhead/tw",
        "COMP_CWORD": "2",
        "_TYPER_COMPLETE_ARGS": "cellwright plan bulkhead/tw",
        "_TYPER_COMPLETE_FISH_ACTION": "get-args",
    }
    code = (
        "import sys; sys.argv = ['cellwright']; from cellwright.engine.faces.cli import main; "
        "main()"
    )
    ran = subprocess.run(
        [sys.executable, "-c", code],
        env=environment,
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert "bulkhead/twelve_points" in ran.stdout, ran.stderr
    assert "bulkhead/one_point" not in ran.stdout


@pytest.fixture
def written(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    found: list[str] = []
    monkeypatch.setattr(progress_line, "write_past_buffers", found.append)
    monkeypatch.setattr(progress_line, "PACE_S", 0.01)
    return found


def await_line(written: list[str]) -> None:
    until = time.monotonic() + 10
    while not any("\r" in each and len(each) > 5 for each in written):
        assert time.monotonic() < until
        time.sleep(0.005)


def test_a_slow_command_says_what_it_does_and_takes_the_line_away(written: list[str]) -> None:
    line = progress_line.ProgressLine("plan", patience_s=0.0)
    line.start()
    await_line(written)
    assert written[0].startswith("\rplanning, 0 s; Ctrl-C stops")
    with line.hushed():
        assert written[-1] == "\r\x1b[K"
        before = len(written)
        time.sleep(0.05)
        assert len(written) == before
    line.end()
    before = len(written)
    time.sleep(0.05)
    assert len(written) == before
    assert written[-1] == "\r\x1b[K"


def test_a_quick_command_says_nothing(written: list[str]) -> None:
    line = progress_line.ProgressLine("plan")
    line.start()
    line.end()
    assert written == []


def test_the_line_fits_on_the_terminal() -> None:
    line = progress_line.ProgressLine("plan")
    line.news = ", best cost 12"
    assert "best cost 12" in line.text(200)
    assert all(
        len(progress_line.ProgressLine(verb).text(80)) < 80
        for verb in (*progress_line.DOING, "store check", "other")
    )


def test_nothing_is_shown_in_a_pipe(written: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(progress_line, "_is_terminal", lambda: False)
    with progress_line.showing_progress("plan"):
        progress_line.tell_progress("more")
        progress_line.clear_progress()
        with progress_line.hushing_progress():
            pass
    assert written == []


@pytest.mark.parametrize("words", [("run", "themse/one"), ("results",), ("resume", "one-1")])
def test_a_home_that_cannot_be_written_is_told_with_the_way_out(
    words: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "file"))
    monkeypatch.delenv("CELLWRIGHT_STORE", raising=False)
    ran = CliRunner().invoke(app, list(words))
    assert ran.exit_code == 2
    assert "K415" in ran.stderr
    assert "--store FILE, or CELLWRIGHT_STORE" in ran.stderr


def test_an_empty_file_of_results_is_told(tmp_path: Path) -> None:
    store = ("--store", str(tmp_path / "runs.db"))
    assert (
        CliRunner().invoke(app, ["run", "themse/in_furnace", "--name", "lab", *store]).exit_code
        == 0
    )
    for kind in ("csv", "qif"):
        told = CliRunner().invoke(
            app, ["results", "lab", "-o", str(tmp_path / f"lab.{kind}"), *store]
        )
        assert told.exit_code == 0
        assert "nothing was measured" in " ".join(told.stdout.split())


def test_a_file_that_is_not_there_is_named_by_one_beside_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "plan.json").touch()
    (tmp_path / "cells").mkdir()
    (tmp_path / "cells" / "mine.yaml").touch()
    assert "did you mean 'plan.json'?" in CliRunner().invoke(app, ["validate", "plan.jsn"]).stderr
    assert (
        "did you mean 'cells/mine.yaml'?"
        in CliRunner().invoke(app, ["plan", "cells/min.yaml"]).stderr
    )
    assert "did you mean" not in CliRunner().invoke(app, ["validate", "nothing"]).stderr
    assert "bundled: " in CliRunner().invoke(app, ["plan", "nowhere/x.yaml"]).stderr


def test_a_file_of_rules_is_told_as_such() -> None:
    result = CliRunner().invoke(app, ["plan", str(TOP / "domains" / "themse" / "rules.lp")])
    assert result.exit_code == 2
    assert "these are rules, not a problem" in result.output


@pytest.mark.parametrize(
    ("name", "advice"),
    [
        ("domain.pddl", "cellwright plan --pddl DOMAIN PROBLEM"),
        ("berlin52.tsp", "cellwright sequence FILE"),
        ("points.CSV", "cellwright import csv FILE"),
        ("part.qif", "cellwright import qif FILE"),
        ("operations.tsv", "cellwright schedule takes them"),
    ],
)
def test_files_of_other_systems_tell_which_command_takes_them(
    tmp_path: Path, name: str, advice: str
) -> None:
    (tmp_path / name).write_text("x\n")
    target = tmp_path if name.endswith(".tsv") else tmp_path / name  # such tables lie in a folder
    result = CliRunner().invoke(app, ["plan", str(target)])
    assert (result.exit_code, advice in result.output) == (2, True)


def test_what_has_no_accepted_answer_tells_how_to_accept_it(tmp_path: Path) -> None:
    create_domain(tmp_path / "cell")
    for each in (tmp_path / "cell" / "golden").iterdir():
        each.unlink()
    result = CliRunner().invoke(app, ["test", str(tmp_path / "cell")])
    assert (result.exit_code, "`--update` accepts the answers" in result.stdout) == (1, True)
