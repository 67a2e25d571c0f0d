"""The command line as it is misused: wrong numbers, closed streams, full disks, signals."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from cellwright.engine.faces.cli import app

COMMAND = (sys.executable, "-m", "cellwright.engine.faces.cli")
FULL = Path("/dev/full")
needs_full = pytest.mark.skipif(not FULL.exists(), reason="this system has no /dev/full")


def refused(*arguments: str) -> str:
    """The first message of the envelope in which a program is told what is wrong with its input."""
    result = CliRunner().invoke(app, [*arguments, "--format", "json"])
    envelope: dict[str, Any] = json.loads(result.stdout)
    assert (result.exit_code, envelope["status"]) == (2, "bad input"), envelope
    return str(envelope["diagnostics"][0]["message"])


BUFFERED = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}


def run(*arguments: str, **how: Any) -> subprocess.CompletedProcess[bytes]:
    """A command as people start it: what Python could not write is tried again at the very end."""
    given = {"capture_output": True, "env": BUFFERED, **how}
    return subprocess.run([*COMMAND, *arguments], timeout=60, check=False, **given)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("plan", "a", "b"), "--pddl"),
        (("plan", "a", "--time-limit", "nan"), "nan"),
        (("plan", "a", "--nosuch"), "--nosuch"),
        (("schedule", "a", "--work", "nan"), "nan"),
        (("cell", "show", "a", "--azimuth", "nan"), "nan"),
        (("validate", "a", "b", "c"), "--pddl"),
        (("validate", "themse/one", "plan.json"), "the plan's file alone"),
        (("macros", "show", "9" * 30, "--store", "a.db"), "range"),
        (
            ("measurement", "add", "a", "m", "--at", "1", "2", "3", "--normal", "0", "0", "0"),
            "normal",
        ),
        (("plan", "bulkhead/one_point", "--store", "postgresql://"), "user"),
        (("nosuch",), "nosuch"),
    ],
)
def test_a_wrong_command_line_is_told_to_programs_as_data(
    arguments: tuple[str, ...], said: str
) -> None:
    assert said in refused(*arguments)


@pytest.mark.parametrize(("text", "said"), [("", "the file is empty"), ("{", "not JSON")])
def test_a_plan_file_without_a_plan_is_not_taken_for_a_domain(
    tmp_path: Path, text: str, said: str
) -> None:
    (tmp_path / "plan.json").write_text(text)
    result = CliRunner().invoke(app, ["validate", str(tmp_path / "plan.json")])
    assert result.exit_code == 2
    assert said in result.stderr
    assert "domain" not in result.stderr


def test_people_are_told_of_a_wrong_command_line_on_standard_error() -> None:
    result = CliRunner().invoke(app, ["plan", "a", "b"])
    assert (result.exit_code, result.stdout) == (2, "")
    assert "--pddl" in result.stderr


@pytest.mark.parametrize("text", ["{}", "[1, 2]", ""])
def test_a_file_that_is_no_tour_is_bad_input(tmp_path: Path, text: str) -> None:
    file = tmp_path / "tour.json"
    file.write_text(text)
    assert "TYPE" in refused("sequence", str(file))


@pytest.mark.parametrize("command", [("macros", "list"), ("diagnose", "bulkhead", "--history")])
def test_a_store_that_is_no_database_is_bad_input(tmp_path: Path, command: tuple[str, ...]) -> None:
    file = tmp_path / "store.db"
    file.write_bytes(b"no database at all" * 300)
    for store in (file, tmp_path):
        assert "cannot be used as a library" in refused(*command, "--store", str(store))


@pytest.mark.parametrize(
    ("done", "said"), [("1..99999999999", "no step 6"), ("5..1", "ends before")]
)
def test_steps_that_no_plan_has_are_refused_at_once(tmp_path: Path, done: str, said: str) -> None:
    file = tmp_path / "plan.json"
    file.write_text(
        CliRunner().invoke(app, ["plan", "bulkhead/one_point", "--format", "json"]).stdout
    )
    assert said in refused("revise", str(file), "--done", done)


@pytest.mark.slow
def test_more_memory_than_there_can_be_is_no_limit() -> None:
    assert run("plan", "bulkhead/one_point", "--memory-limit", "9" * 30).returncode == 0


@pytest.mark.parametrize("encoding", ["ascii", pytest.param("latin-1", marks=pytest.mark.slow)])
def test_no_answer_fails_for_its_characters(encoding: str) -> None:
    shown = run("schedule", "bulkhead/one_point", env={**os.environ, "PYTHONIOENCODING": encoding})
    assert (shown.returncode, shown.stderr) == (0, b"")
    told = run(
        "plan",
        "zellenprüfung",
        "--format",
        "json",
        env={**os.environ, "PYTHONIOENCODING": encoding},
    )
    assert json.loads(told.stdout.decode("utf-8"))["diagnostics"][0]["file"] == "zellenprüfung"


@pytest.mark.slow
@pytest.mark.parametrize(("target", "code"), [("bulkhead/one_point", 0), ("bulkhead/nosuch", 2)])
def test_closed_streams_change_no_exit_code(target: str, code: int) -> None:
    words = " ".join((*COMMAND, "plan", target))
    for closed in ("<&-", ">&-", "2>&-", ">&- 2>&-"):
        assert (
            subprocess.run(["sh", "-c", f"{words} {closed}"], capture_output=True).returncode
            == code
        )


@needs_full
@pytest.mark.parametrize(
    "arguments", [("plan", "bulkhead/one_point"), ("--help",), ("plan", "--help")]
)
def test_a_full_disk_is_said_without_a_traceback(arguments: tuple[str, ...]) -> None:
    with FULL.open("wb") as full:
        result = run(*arguments, capture_output=False, stdout=full, stderr=subprocess.PIPE)
    assert result.returncode == 2
    assert result.stderr == b"cannot write the answer: No space left on device\n"


@needs_full
def test_who_cannot_be_told_why_gets_the_exit_code() -> None:
    with FULL.open("wb") as full:
        assert run("plan", "bulkhead/nosuch", capture_output=False, stderr=full).returncode == 2


@needs_full
@pytest.mark.parametrize(
    "arguments",
    [
        pytest.param(("check", "bulkhead/one_point", "--no-reach"), marks=pytest.mark.slow),
        ("plan", "bulkhead/one_point", "--anytime", "--time-limit", "15"),
    ],
)
def test_who_cannot_be_told_of_progress_gets_the_answer(arguments: tuple[str, ...]) -> None:
    with FULL.open("wb") as full:
        result = run(*arguments, capture_output=False, stdout=subprocess.PIPE, stderr=full)
    assert result.returncode == 0
    assert result.stdout


@pytest.mark.parametrize(
    ("sent", "options"),
    [pytest.param(signal.SIGINT, ("--race",), marks=pytest.mark.slow), (signal.SIGTERM, ())],
)
def test_a_signal_ends_the_search_with_the_best_plan_so_far(
    sent: signal.Signals, options: tuple[str, ...]
) -> None:
    arguments = (
        "plan",
        "themse/four",
        "--anytime",
        *options,
        "--time-limit",
        "60",
        "--format",
        "json",
    )
    with _started(*arguments) as process:
        process.send_signal(sent)
        told, _ = process.communicate(timeout=20)
    assert (process.returncode, json.loads(told)["status"]) == (130, "found")


@pytest.mark.slow
def test_strategies_do_not_outlive_the_race() -> None:
    """The strategies hold standard error open; its end comes when the last of them is gone."""
    with _started("plan", "themse/four", "--anytime", "--race", "--time-limit", "60") as process:
        process.kill()
        began = time.monotonic()
        process.communicate(timeout=40)
    assert time.monotonic() - began < 20


@pytest.mark.slow
@pytest.mark.parametrize("presses", [1, 2])
def test_ctrl_c_at_a_terminal_ends_a_preparation_quietly(tmp_path: Path, presses: int) -> None:
    """A terminal sends Ctrl-C to the whole group of processes, while those that plan are still
    starting, too.
    """
    words = (
        "prepare",
        "themse",
        "--store",
        str(tmp_path / "store.db"),
        "--jobs",
        "2",
        "--format",
        "json",
    )
    how: dict[str, Any] = {
        "stdout": subprocess.PIPE,
        "stderr": subprocess.PIPE,
        "start_new_session": True,
    }
    with subprocess.Popen([*COMMAND, *words], **how) as process:
        while not (tmp_path / "store.db").exists():
            time.sleep(0.01)
        for _ in range(presses):
            time.sleep(0.6)
            os.killpg(process.pid, signal.SIGINT)
        told, said = process.communicate(timeout=60)
    assert (process.returncode, said) == (130, b"")
    # it may end before the second
    ends = {"incomplete"} if presses == 1 else {"incomplete", "interrupted"}
    assert json.loads(told)["status"] in ends


@pytest.mark.slow
@pytest.mark.parametrize(
    ("jobs", "after"), [("1", 0.0), ("1", 0.2), ("1", 0.6), ("2", 0.0), ("2", 0.6)]
)
def test_at_the_first_ctrl_c_a_preparation_tells_of_every_problem(
    tmp_path: Path, jobs: str, after: float
) -> None:
    """Also while it still reads the first problem, where no search hears it."""
    words = (
        "prepare",
        "themse",
        "--store",
        str(tmp_path / "store.db"),
        "--jobs",
        jobs,
        "--format",
        "json",
    )
    with subprocess.Popen(
        [*COMMAND, *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as process:
        while not (tmp_path / "store.db").exists():
            time.sleep(0.01)
        time.sleep(after)
        process.send_signal(signal.SIGINT)
        told, _ = process.communicate(timeout=60)
    problems = json.loads(told)["data"]["problems"]
    assert (process.returncode, len(problems)) == (130, 8)
    assert problems[-1]["status"] == "gave up"
    assert "interrupted" in problems[-1]["reason"]


def _started(*arguments: str) -> subprocess.Popen[bytes]:
    """A search that has told of its first plan."""
    process = subprocess.Popen(
        [*COMMAND, *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    assert process.stderr is not None
    assert b"steps" in process.stderr.readline()
    return process


@pytest.mark.parametrize("arguments", [("--help",), ("plan", "themse/four"), ("check", "bulkhead")])
def test_ctrl_c_while_modules_are_loaded_ends_the_process_without_a_word(
    arguments: tuple[str, ...],
) -> None:
    """Interrupted at the import of the module that everything is loaded by."""
    code = (
        "import os, signal, sys\n"
        "class Interrupting:\n"
        "    def find_spec(self, name, path=None, target=None):\n"
        "        if name == 'cellwright.engine.faces.cli.invocation': os.kill(os.getpid(), "
        "signal.SIGINT)\n"
        "sys.meta_path.insert(0, Interrupting())\n"
        "from cellwright.engine.faces.cli import main\n"
        "main()\n"
    )
    result = subprocess.run(
        [sys.executable, "-c", code, *arguments], capture_output=True, timeout=60, check=False
    )
    assert (result.returncode, result.stdout, result.stderr) == (-signal.SIGINT, b"", b"")


@pytest.mark.parametrize(
    "verb", [("macros", "import", "FILE"), ("diagnose", "bulkhead", "--import", "FILE")]
)
def test_a_file_nested_without_end_is_bad_input(tmp_path: Path, verb: tuple[str, ...]) -> None:
    file = tmp_path / "deep.json"
    file.write_text("[" * 100_000)
    arguments = (str(file) if word == "FILE" else word for word in verb)
    assert "nested too deeply" in refused(*arguments, "--store", str(tmp_path / "store.db"))


@pytest.mark.parametrize(
    ("asked", "code"),
    [
        (("themse/one", "--fault", "heat=nonsense"), 2),
        (("themse/one", "--fault", "99=not_gripped"), 2),
        (("themse/unsolvable",), 10),
    ],
)
def test_a_run_that_never_began_is_not_listed(
    tmp_path: Path, asked: tuple[str, ...], code: int
) -> None:
    store = ("--store", str(tmp_path / "runs.db"))
    assert CliRunner().invoke(app, ["run", *asked, *store]).exit_code == code
    assert "no runs" in CliRunner().invoke(app, ["results", *store]).stdout
