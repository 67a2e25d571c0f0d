"""The live display on a terminal: keys tell the run what to do, and the terminal is left as it
was.
"""

import os
import pty
import select
import subprocess
import sys
import termios
import time
from pathlib import Path

import pytest

TOP = Path(__file__).parents[4]
PATIENCE_S = 60.0


def shown(terminal: int, until: bytes, seconds: float = PATIENCE_S) -> bytes:
    """What comes on a terminal until a text is there, or the time is over, or nobody writes any
    more.
    """
    found, end = b"", time.monotonic() + seconds
    while until not in found and time.monotonic() < end:
        if select.select([terminal], [], [], 0.2)[0]:
            try:
                found += os.read(terminal, 65_536)
            except OSError:
                break
    return found


def typed(words: list[str], keys: str, outcome: bytes, folder: Path) -> tuple[bytes, int]:
    """What a command shows on a terminal where `keys` are pressed once its display is there,
    and its exit code.
    """
    outer, inner = pty.openpty()
    before = termios.tcgetattr(inner)
    line = [
        sys.executable,
        "-m",
        "cellwright.engine.faces.cli",
        *words,
        "--watch",
        "--store",
        str(folder / "r.db"),
    ]
    environment = {
        **os.environ,
        "PYTHONPATH": str(TOP),
        "TERM": "xterm",
        "COLUMNS": "120",
        "LINES": "40",
    }
    with subprocess.Popen(
        line, stdin=inner, stdout=inner, stderr=inner, env=environment, cwd=folder
    ) as run:
        seen = shown(outer, b"mars_gripper")
        assert b"mars_gripper" in seen or b"pick" in seen, seen[-2_000:]
        for key in keys:
            os.write(outer, key.encode())
            time.sleep(0.3)
        found = shown(outer, outcome)
        assert outcome in found, found[-2_000:]
        run.wait(PATIENCE_S)
    assert termios.tcgetattr(inner)[3] == before[3]
    os.close(outer)
    os.close(inner)
    return seen + found, run.returncode


@pytest.mark.slow
@pytest.mark.parametrize(
    ("keys", "outcome", "code"), [("s", b"stopped safely", 40), ("ps", b"stopped", 40)]
)
def test_keys_reach_the_run_and_the_terminal_is_left_as_it_was(
    keys: str, outcome: bytes, code: int, tmp_path: Path
) -> None:
    words = ["run", "themse/one", "--factor", "0.02", "--name", f"keys-{os.getpid()}"]
    assert typed(words, keys, outcome, tmp_path)[1] == code


@pytest.mark.slow
def test_a_run_that_is_taken_up_again_is_shown_from_where_it_was(tmp_path: Path) -> None:
    name = f"shown-{os.getpid()}"
    typed(
        ["run", "themse/one", "--factor", "0.02", "--name", name], "s", b"stopped safely", tmp_path
    )
    seen, code = typed(
        ["resume", name, "--factor", "0.001"], "", b"all goals are reached", tmp_path
    )
    assert code == 0
    assert f"{name}: running".encode() in seen
    assert b"stopped by order" in seen, "the log goes on from where it was"
