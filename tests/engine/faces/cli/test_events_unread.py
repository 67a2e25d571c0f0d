"""A run goes on where nobody reads its events any more, and says so once."""

import subprocess
import sys
from pathlib import Path

import pytest

from cellwright.kb.store.journal import Journal

RUN = [sys.executable, "-m", "cellwright.engine.faces.cli", "run", "themse/one", "--name", "unread"]


@pytest.mark.slow
def test_a_run_whose_events_nobody_reads_any_more_goes_on_and_says_so_once(tmp_path: Path) -> None:
    store = str(tmp_path / "runs.db")
    line = [
        *RUN,
        "--store",
        store,
        "--events",
        "-",
        "--factor",
        "0.0005",
    ]  # 0.7 s: the reader is gone long before
    with subprocess.Popen(line, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as ran:
        assert ran.stdout is not None
        assert ran.stderr is not None
        read = [ran.stdout.readline() for _ in range(3)]
        ran.stdout.close()
        said = ran.stderr.read()
    assert all(each.startswith('{"version": 1, "run": "unread"') for each in read)
    assert (ran.returncode, said) == (0, "no more events: Broken pipe; the run goes on\n")
    with Journal(store) as journal:
        (end,) = journal.lines("unread", kinds=["end"])
    assert end.content["outcome"] == "reached"
