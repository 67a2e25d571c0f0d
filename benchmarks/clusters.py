"""A Dask cluster of our own whose processes can be killed, for tests and benchmarks."""

import os
import random
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path


@dataclass
class Cluster:
    """A scheduler and a nanny with its workers, in process groups of their own."""

    root: Path
    workers: int
    port: int
    processes: dict[str, subprocess.Popen[bytes]] = field(default_factory=dict)

    @classmethod
    @contextmanager
    def started(cls, root: Path, workers: int) -> Iterator["Cluster"]:
        """A cluster that runs."""
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            made = cls(root, workers, free.getsockname()[1])
        made.start()
        try:
            yield made
        finally:
            made.end()

    @property
    def address(self) -> str:
        """Where its scheduler listens."""
        return f"127.0.0.1:{self.port}"

    def start(self) -> None:
        """Start what does not run, and wait until the workers are there."""
        from distributed import Client

        self._run("scheduler", "--host", "127.0.0.1", "--port", str(self.port), "--no-show")
        deadline = time.monotonic() + 60
        while not self._is_open() and time.monotonic() < deadline:
            time.sleep(0.1)
        self._run(
            "worker", f"tcp://{self.address}", "--nworkers", str(self.workers), "--nthreads", "1"
        )
        with Client(f"tcp://{self.address}", timeout=60, set_as_default=False) as client:
            client.wait_for_workers(self.workers, timeout=120)

    def _is_open(self) -> bool:
        with socket.socket() as probe:
            return probe.connect_ex(("127.0.0.1", self.port)) == 0

    def _run(self, role: str, *arguments: str) -> None:
        if role in self.processes and self.processes[role].poll() is None:
            return
        program = f"from distributed.cli.dask_{role} import main; main()"
        self.processes[role] = subprocess.Popen(
            [sys.executable, "-c", program, *arguments, "--no-dashboard"],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
            env={**os.environ, "PYTHONPATH": str(self.root)},
        )

    def kill(self, victim: str, chance: random.Random) -> None:
        """Kill the scheduler, or one worker; a nanny starts a worker again, and ends without a
        scheduler.
        """
        if victim == "scheduler":
            self.processes["scheduler"].kill()
            self.processes["scheduler"].wait()
            self._end("worker")
            return
        found = self._children(self.processes["worker"].pid)
        if found:
            with suppress(ProcessLookupError):
                os.kill(chance.choice(found), signal.SIGKILL)

    def _children(self, parent: int) -> list[int]:
        """The workers of the nanny: its children that carry units out."""
        found = []
        for each in Path("/proc").glob("[0-9]*"):
            with suppress(OSError, ValueError, IndexError):
                if int((each / "stat").read_text().rpartition(")")[2].split()[1]) == parent:
                    found.append((int(each.name), (each / "cmdline").read_bytes()))
        return [number for number, command in found if b"spawn_main" in command]

    def end(self) -> None:
        """End all."""
        for role in ("worker", "scheduler"):
            self._end(role)

    def _end(self, role: str) -> None:
        process = self.processes.pop(role, None)
        if process is not None:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()
