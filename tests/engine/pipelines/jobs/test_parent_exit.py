"""A pool's process does not outlive the process that started it."""

import os
import signal
import subprocess
import sys
import time

SCRIPT = """
import multiprocessing, os, time
from concurrent.futures import ProcessPoolExecutor
from cellwright.engine.pipelines.jobs.parent_exit import end_with_parent

if __name__ == "__main__":
    pool = ProcessPoolExecutor(1, multiprocessing.get_context("spawn"), end_with_parent)
    print(pool.submit(os.getpid).result(), flush=True)
    time.sleep(60)
"""


def is_there(process: int) -> bool:
    """Whether there is a process of this number."""
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    return True


def test_a_process_whose_parent_is_killed_ends() -> None:
    with subprocess.Popen(
        [sys.executable, "-c", SCRIPT], stdout=subprocess.PIPE, text=True, cwd=os.getcwd()
    ) as parent:
        assert parent.stdout is not None
        child = int(parent.stdout.readline())
        assert is_there(child)
        parent.send_signal(signal.SIGKILL)
        parent.wait()
        end = time.monotonic() + 30
        while is_there(child) and time.monotonic() < end:
            time.sleep(0.05)
        assert not is_there(child)
