"""Limits bound whole commands, also where nothing asks whether to stop; Ctrl-C is heard
everywhere.
"""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from benchmarks.limits_work import DOMAIN, PROBLEM

ENDLESS = {
    "domain.yaml": DOMAIN,
    "rules.lp": "n(1..30000*30000).\n",
    "problem.yaml": PROBLEM,
}
WEIGHED = """
import resource, subprocess, sys
ran = subprocess.run(sys.argv[1:])
print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)  # kilobytes; a small process forks it, so that it is its own
sys.exit(ran.returncode)
"""
COMMAND = [sys.executable, "-m", "cellwright.engine.faces.cli"]


@pytest.fixture
def cell(tmp_path: Path) -> Path:
    for name, text in ENDLESS.items():
        (tmp_path / name).write_text(text)
    return tmp_path


@pytest.mark.parametrize("verb", ["plan", "check", "schedule", "explain", "prepare"])
def test_the_time_limit_bounds_every_command(verb: str, cell: Path) -> None:
    wanted = [*COMMAND, verb, str(cell / "problem.yaml"), "--time-limit", "0.3"]
    wanted += ["--store", str(cell / "library.db")] if verb == "prepare" else []
    before = os.times()
    ran = subprocess.run(wanted, capture_output=True, text=True, check=False)
    after = os.times()
    assert ran.returncode == 23, ran.stderr
    assert "K420" in ran.stderr
    # asked 0.3 s, after the start of the process
    assert after.children_user - before.children_user < 4


def test_the_end_of_the_time_is_told_as_data(cell: Path) -> None:
    wanted = [
        *COMMAND,
        "plan",
        str(cell / "problem.yaml"),
        "--time-limit",
        "0.3",
        "--format",
        "json",
    ]
    ran = subprocess.run(wanted, capture_output=True, text=True, check=False)
    found = json.loads(ran.stdout)
    assert (ran.returncode, found["status"], found["diagnostics"][0]["code"]) == (
        23,
        "stopped",
        "K420",
    )


@pytest.mark.slow
def test_a_preparation_whose_time_is_over_tells_of_every_problem(tmp_path: Path) -> None:
    words = [
        "prepare",
        "themse",
        "--jobs",
        "1",
        "--store",
        str(tmp_path / "s.db"),
        "--format",
        "json",
    ]
    for seconds in ("1", "2", "4", "8", "16"):  # a busy machine has not begun after few seconds
        ran = subprocess.run(
            [*COMMAND, *words, "--time-limit", seconds], capture_output=True, text=True, check=False
        )
        assert ran.returncode == 23
        told = json.loads(ran.stdout)["data"].get("problems", ())
        if told:
            break
    assert len(told) == 8


@pytest.mark.slow
def test_ctrl_c_ends_a_command_that_grounds(cell: Path) -> None:
    running = subprocess.Popen(
        [*COMMAND, "check", str(cell / "problem.yaml")],
        stderr=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    time.sleep(3)
    running.send_signal(signal.SIGINT)
    _, said = running.communicate(timeout=30)
    assert (running.returncode, said.strip().splitlines()[-1]) == (130, "interrupted")


def test_a_problem_that_needs_no_grounding_keeps_its_answer(cell: Path) -> None:
    (cell / "rules.lp").write_text("n(1..3).\n")
    wanted = [
        *COMMAND,
        "plan",
        str(cell / "problem.yaml"),
        "--time-limit",
        "60",
        "--memory-limit",
        "4000",
    ]
    assert subprocess.run(wanted, capture_output=True, check=False).returncode == 0


IN_A_CALLBACK = """
import time, weakref
from cellwright.engine.faces.cli.process import process_limits
from cellwright.kb.stopping import StoppedByCaller

class Module: pass

def busy(seconds):
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        pass

LATE
process_limits.own_process()
with process_limits.watching_command(0.1, None):
    process_limits.current_watch().asked = True
    module = Module()
    watched = weakref.ref(module, lambda _: busy(0.5))
    del module  # the time is over while Python runs the callback, and Python passes no exception on from there
    try:
        busy(0.5)
        print("went on")
    except StoppedByCaller:
        print("stopped")
"""


LATE = """
import threading
start = threading.Timer.start

def started_late(timer):
    start(timer)
    busy(0.1)  # as if the processors had something else to do while the thread begins

threading.Timer.start = started_late
"""


@pytest.mark.parametrize("late", ["", LATE], ids=["at once", "on a busy machine"])
def test_an_end_that_comes_in_a_callback_is_heard_and_prints_nothing(late: str) -> None:
    code = IN_A_CALLBACK.replace("LATE", late)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.stdout, done.stderr) == ("stopped\n", "")


@pytest.mark.parametrize("work", ["grounding", "themse/four", "bulkhead/three_stations"])
def test_the_memory_limit_is_kept_and_told(work: str, cell: Path) -> None:
    """Resident memory is what counts; linear algebra reserves more, and must not end the
    process by itself.
    """
    motion = ["motion", "play", work, "--output", str(cell / "film.gltf")]
    words = ["plan", str(cell / "problem.yaml")] if work == "grounding" else motion
    ran = subprocess.run(
        [sys.executable, "-c", WEIGHED, *COMMAND, *words, "--memory-limit", "128"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert ran.returncode == 23, ran.stderr
    assert ("K307" if work == "grounding" else "K419") in ran.stderr
    assert "Traceback" not in ran.stderr
    assert int(ran.stdout.split()[-1]) / 1024 < 1.2 * 128


def test_what_fails_after_ctrl_c_fails_because_of_it() -> None:
    """A library that is half loaded when Ctrl-C comes may raise anything."""
    script = """
import signal
from cellwright.engine.faces.cli.output.answer_output import AnswerForm, give_answer
from cellwright.engine.faces.cli.process.process_limits import own_process, watching_command

def work():
    try:
        signal.raise_signal(signal.SIGINT)
    except KeyboardInterrupt:
        raise ImportError("failed to import") from None

own_process()
try:
    with watching_command(None, None):
        give_answer(work, AnswerForm.TEXT)
except Exception as end:
    raise SystemExit(end.exit_code)
"""
    ran = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=False
    )
    assert (ran.returncode, "interrupted" in ran.stderr) == (130, True), ran.stderr


def test_a_command_ends_at_once_and_leaves_its_library_closed(tmp_path: Path) -> None:
    store = tmp_path / "library.db"
    words = ["plan", "themse/one", "--store", str(store)]
    ran = subprocess.run([*COMMAND, *words], capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stderr
    # no log of changes beside it
    assert [each.name for each in tmp_path.iterdir()] == ["library.db"]


LEFT_AT_WORK = """
import sys, threading, time
from cellwright.engine.faces.cli.output.answer_output import leave_process
threading.Thread(target=time.sleep, args=(1.5,)).start()
leave_process(int(sys.argv[1]))
print("it waits")
"""


@pytest.mark.parametrize(("code", "said"), [(0, "it waits\n"), (23, ""), (130, "")])
def test_what_a_limit_ended_does_not_wait_for_the_threads_of_a_solver(code: int, said: str) -> None:
    told = subprocess.run(
        [sys.executable, "-c", LEFT_AT_WORK, str(code)], capture_output=True, text=True
    )
    assert (told.returncode, told.stdout, told.stderr) == (code, said, "")
