"""Processes that are started anew: nothing of them depends on what other threads do."""

import os
import subprocess
import sys
import time
from multiprocessing.connection import Connection
from pathlib import Path

import pytest

import cellwright
from cellwright import engine, kb
from cellwright.kb.clean_process import CleanProcess

FORKS = ("os.fork(", 'get_context("fork")', "forkpty(")


def return_doubles(connection: Connection) -> None:
    """Answers each number with twice the number, and a text with the number of the parent."""
    while True:
        asked = connection.recv()
        connection.send(os.getppid() if isinstance(asked, str) else 2 * asked)


def test_a_process_answers_as_often_as_it_is_asked_and_ends_when_it_is_told() -> None:
    process = CleanProcess(return_doubles)
    for number in range(3):
        process.connection.send(number)
        assert process.connection.recv() == 2 * number
    process.connection.send("who")
    assert process.connection.recv() == os.getpid()
    process.kill()
    with pytest.raises(ProcessLookupError):
        os.kill(process.pid, 0)


def test_a_process_ends_with_its_parent() -> None:
    text = """
import os, sys
from cellwright.kb.clean_process import CleanProcess
from tests.kb.test_clean_process import return_doubles
process = CleanProcess(return_doubles)
process.connection.send(1)
assert process.connection.recv() == 2
os.write(1, str(process.pid).encode())
os._exit(0)
"""
    ended = subprocess.run(
        [sys.executable, "-c", text],
        stdout=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
        timeout=60,
        check=True,
    )
    for _ in range(100):
        if not Path(f"/proc/{int(ended.stdout)}").exists():
            break
        time.sleep(0.05)
    assert not Path(f"/proc/{int(ended.stdout)}").exists()


def test_no_module_forks_this_process() -> None:
    """A fork in a program with threads may wait for ever for a lock that nobody holds."""
    folders = [Path(each.__file__).parent for each in (cellwright, kb, engine)]
    texts = {path: path.read_text() for folder in folders for path in folder.glob("**/*.py")}
    assert not [path for path, text in texts.items() if any(fork in text for fork in FORKS)]
    assert len(texts) > 100
