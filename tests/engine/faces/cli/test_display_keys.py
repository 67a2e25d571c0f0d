"""The live display on a terminal: keys tell the run what to do, and the terminal is left as it was."""

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
    """What comes on a terminal until a text is there, or the time is over, or nobody writes any more."""
    found, end = b"", time.monotonic() + seconds
    while until not in found and time.monotonic() < end:
        if select.select([terminal], [], [], 0.2)[0]:
            try:
                found += os.read(terminal, 65_536)
            except OSError:
                break
    return found


@pytest.mark.slow
@pytest.mark.parametrize(("keys", "outcome", "code"), [("s", b"stopped safely", 40), ("ps", b"stopped", 40)])
def test_keys_reach_the_run_and_the_terminal_is_left_as_it_was(
    keys: str, outcome: bytes, code: int, tmp_path: Path
) -> None:
    outer, inner = pty.openpty()
    before = termios.tcgetattr(inner)
    line = [sys.executable, "-m", "engine.faces.cli", "run", "themse/one", "--watch", "--factor", "0.02"]
    line += ["--store", str(tmp_path / "r.db"), "--name", f"keys-{os.getpid()}"]
    environment = {**os.environ, "PYTHONPATH": str(TOP), "TERM": "xterm", "COLUMNS": "120", "LINES": "40"}
    with subprocess.Popen(
        line, stdin=inner, stdout=inner, stderr=inner, env=environment, cwd=tmp_path
    ) as run:
        seen = shown(outer, b"mars_gripper")
        assert b"mars_gripper" in seen or b"pick" in seen, seen[-2_000:]
        for key in keys:
            os.write(outer, key.encode())
            time.sleep(0.3)
        seen = shown(outer, outcome)
        assert outcome in seen, seen[-2_000:]
        run.wait(PATIENCE_S)
    assert run.returncode == code
    assert termios.tcgetattr(inner)[3] == before[3]
    os.close(outer)
    os.close(inner)
