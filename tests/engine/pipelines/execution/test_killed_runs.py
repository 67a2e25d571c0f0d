"""A run whose process is killed while its controller lives on in another: resumed, it repeats
nothing and reaches its goals.
"""

import json
import os
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest

CLI = [sys.executable, "-m", "cellwright.engine.faces.cli"]
TOP = Path(__file__).parents[4]
TARGET = str(TOP / "tests/domains/capping/problems/no_caps.yaml")
ENVIRONMENT = {**os.environ, "PYTHONPATH": os.pathsep.join([*sys.path, str(TOP)])}


@pytest.fixture
def address(tmp_path: Path) -> Iterator[str]:
    """Where a simulated cell listens, in a process of its own, with a fault in it."""
    line = [
        *CLI,
        "driver",
        "serve",
        TARGET,
        "--listen",
        "127.0.0.1:0",
        "--fault",
        "cap=cap_crooked",
    ]
    line += ["--option", f"log={tmp_path / 'cell.log'}"]
    with subprocess.Popen(line, stderr=subprocess.PIPE, text=True, env=ENVIRONMENT) as cell:
        assert cell.stderr is not None
        told = cell.stderr.readline()
        yield told.split()[-1]
        cell.kill()


def killed_after(events: int, line: list[str]) -> bool:
    """Run a command line that writes events to its output, and kill it after some of them;
    whether it was still running.
    """
    with subprocess.Popen(line, stdout=subprocess.PIPE, text=True, env=ENVIRONMENT) as run:
        assert run.stdout is not None
        seen = sum(1 for _, _ in zip(range(events), run.stdout, strict=False))
        run.kill()
    return seen == events


@pytest.mark.slow
@pytest.mark.parametrize("events", [3, 9, 20, 31])
def test_a_killed_run_is_resumed_over_the_line_and_nothing_is_done_twice(
    events: int, address: str, tmp_path: Path
) -> None:
    store, name = str(tmp_path / "runs.db"), f"killed-{os.getpid()}-{events}"
    line = [
        *CLI,
        "run",
        TARGET,
        "--name",
        name,
        "--store",
        store,
        "--events",
        "-",
        "--driver",
        "external",
    ]
    assert killed_after(events, [*line, "--option", f"address={address}"])
    again = [*CLI, "resume", name, "--store", store, "--format", "json"]
    ended = subprocess.run(again, capture_output=True, text=True, env=ENVIRONMENT, check=False)
    assert ended.returncode == 0, ended.stderr
    assert json.loads(ended.stdout)["status"] == "reached"
    log = [
        json.loads(each) for each in (tmp_path / "cell.log").read_text("utf-8").splitlines() if each
    ]
    numbers = Counter(each["ended"] for each in log if "ended" in each)
    assert max(numbers.values()) == 1
    done = Counter(each["action"] for each in log if "ended" in each and each["reply"] == "done")
    assert all(
        count == 1 for action, count in done.items() if action.startswith(("pick", "put", "fill"))
    )
