"""Commands that a page starts: runs, and work that takes long. Each goes on in a process of its own, also without the monitor."""

import os
import pty
import re
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

LONG = ("prepare", "sequence", "plan", "schedule", "test")  # what is shown with its progress
CONTROL = re.compile(r"\x1b\[[0-9;?]*[ -/]*[@-~]|\x1b[@-_]|[\x00-\x08\x0b\x0c\x0e-\x1f]")
KEPT = 20_000  # characters of what a command prints
COMMAND = (sys.executable, "-m", "cellwright.engine.faces.cli")


@dataclass
class Job:
    """A command of the command line that works: `text` is what it has printed last, `code` how it ended."""

    words: tuple[str, ...]
    text: str = ""
    code: int | None = None
    began_s: float = field(default_factory=time.monotonic)
    lasted_s: float = 0.0

    @property
    def seconds(self) -> float:
        """How long it has worked."""
        return self.lasted_s if self.code is not None else time.monotonic() - self.began_s


def started(words: Sequence[str], folder: Path) -> Job:
    """A command that works with a terminal of its own, so that it tells of its progress."""
    ours, theirs = pty.openpty()
    job = Job(tuple(words))
    size = {**os.environ, "COLUMNS": "110", "LINES": "40", "TERM": "xterm"}
    process = subprocess.Popen(
        [*COMMAND, *words], cwd=folder, env=size, stdin=subprocess.DEVNULL, stdout=theirs, stderr=theirs, start_new_session=True
    )  # fmt: skip
    os.close(theirs)
    threading.Thread(target=_follow, args=(job, process, ours), daemon=True).start()
    return job


def _follow(job: Job, process: subprocess.Popen[bytes], ours: int) -> None:
    raw = ""
    with os.fdopen(ours, "rb", buffering=0) as stream:
        while True:
            try:
                part = stream.read(4096)
            except OSError:  # the other end is closed
                break
            if not part:
                break
            raw = (raw + part.decode("utf-8", "replace"))[-KEPT:]
            job.text = shown(raw)
    job.code, job.lasted_s = process.wait(), time.monotonic() - job.began_s


def shown(raw: str) -> str:
    """What a terminal would show of a text: without control sequences, each line as it was written last."""
    lines = CONTROL.sub("", raw.replace("\r\n", "\n")).split("\n")
    return "\n".join(line.rstrip("\r").rpartition("\r")[2].rstrip() for line in lines).strip()


def begun(words: Sequence[str], folder: Path, there: Callable[[], bool], wait_s: float = 60.0) -> str:
    """Start a run in the background; what it complained of if it ended before it was `there`, else nothing."""
    with tempfile.TemporaryFile("w+", encoding="utf-8", errors="replace") as said:
        process = subprocess.Popen(
            [*COMMAND, *words], cwd=folder, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=said,
            start_new_session=True,
        )  # fmt: skip
        threading.Thread(target=process.wait, daemon=True).start()
        until = time.monotonic() + wait_s
        while time.monotonic() < until:
            over = process.poll() is not None
            if there():
                return ""
            if over:
                said.seek(0)
                return said.read().strip() or f"ended with {process.returncode}"
            time.sleep(0.1)
    return "it has not begun yet; it may still do so"
