"""Every way to end a run is a safe end: the controller hears `quiesce` or `halt`, whatever happens.

    python benchmarks/endings.py [--times N] [--seed N] [--kept FILE] [--target TARGET] [WAY ...]

WAY is one of those in WAYS; left out, all. For each a run over the driver `external` is ended at a
random moment, on a virtual and on a real clock. What each controller has heard, how the process
ended and whether its journal is whole is looked at, and is kept in FILE: a campaign that was
stopped goes on behind what is there. Exits with 1 if something is wrong.
"""

import argparse
import json
import os
import pty
import random
import resource
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from cellwright.engine.model.run_protocol import Reply
from cellwright.engine.pipelines.execution.controllers.protocol import protocol_line, reply_entry
from cellwright.engine.pipelines.execution.controllers.reference_controller import (
    Conversation,
    ServedCell,
)
from cellwright.engine.pipelines.planning.checked_plan import problem_of
from cellwright.engine.ports import DriverSetup
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.store.journal import Journal

TARGET = "themse/one"
PATIENCE_S = 40.0  # for a process to end; more is wrong
SERVICE_S = 10.0  # after which a container engine kills
ENDED = (0, 1, 40)
BEFORE = (130, -signal.SIGTERM, -signal.SIGHUP, -signal.SIGINT)  # nothing was greeted


class ListeningCell:
    """A controller of a simulated cell that notes which questions it has heard."""

    def __init__(self, problem: Problem, factor: float) -> None:
        self.cell = ServedCell(DriverSetup(problem, "", 0, factor, {}))
        self.heard: list[str] = []
        self.greeted = threading.Event()
        self._pen = threading.Lock()
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.port = self.listener.getsockname()[1]
        threading.Thread(target=self._serve, daemon=True).start()

    def _serve(self) -> None:
        with suppress(OSError):
            while True:
                line, _ = self.listener.accept()
                threading.Thread(target=self._converse, args=(line,), daemon=True).start()

    def _converse(self, line: socket.socket) -> None:
        over = threading.Event()
        threading.Thread(target=self._tick, args=(line, over), daemon=True).start()
        with line, suppress(OSError):
            conversation = Conversation(self.cell)
            for text in line.makefile("rb"):
                with self._pen:
                    self.heard.append(json.loads(text)["type"])
                    line.sendall(b"".join(conversation.answers(text)))
                if self.heard[-1] == "hello":
                    self.greeted.set()
        over.set()

    def _tick(self, line: socket.socket, over: threading.Event) -> None:
        while not over.wait(0.01):
            with self._pen, suppress(OSError):
                for message in self.cell.elapsed():
                    if isinstance(message, Reply):
                        line.sendall(protocol_line("reply", **reply_entry(message)))

    def is_safe(self) -> bool:
        """Whether it has heard `quiesce` or `halt` since it was greeted last."""
        if "hello" not in self.heard:
            return True
        last = len(self.heard) - self.heard[::-1].index("hello")
        return bool({"quiesce", "halt"} & set(self.heard[last:]))


@dataclass
class Attempt:
    """One run that is to be ended: its process, its controller, and where its files are."""

    chance: random.Random
    cell: ListeningCell
    folder: Path
    process: subprocess.Popen[bytes] | None = None
    master: int = -1
    manager: socket.socket | None = None
    told: list[str] = field(default_factory=list)

    @property
    def pid(self) -> int:
        """The process of the run."""
        assert self.process is not None
        return self.process.pid

    def send(self, *signals: int) -> None:
        """Send signals to the process of the run, as long as it lives."""
        assert self.process is not None
        for number in signals:
            if self.process.poll() is None:
                os.kill(self.pid, number)

    def states(self) -> str:
        """What the service manager was told."""
        assert self.manager is not None
        with suppress(OSError):
            while True:
                self.told.append(self.manager.recv(4096).decode())
        return "\n".join(self.told)


def _once(attempt: Attempt) -> None:
    """Ctrl-C once: the run pauses, and its controller hears that; then it is told to end."""
    attempt.send(signal.SIGINT)
    end = time.monotonic() + PATIENCE_S / 2
    assert attempt.process is not None
    while (
        attempt.process.poll() is None
        and time.monotonic() < end
        and not ("hello" in attempt.cell.heard and attempt.cell.is_safe())
    ):
        time.sleep(0.02)
    if not attempt.cell.is_safe():
        attempt.told.append("nothing was heard after Ctrl-C")
    attempt.send(signal.SIGTERM)


def _twice(attempt: Attempt) -> None:
    attempt.send(signal.SIGINT)
    time.sleep(attempt.chance.uniform(0, 0.3))
    attempt.send(signal.SIGINT)


def _fill_disk(attempt: Attempt) -> None:
    """No file may grow any more."""
    sizes = [file.stat().st_size for file in attempt.folder.glob("runs.db*")]
    limit = max(sizes, default=0) if attempt.chance.random() < 0.5 else min(sizes, default=0)
    with suppress(ProcessLookupError):
        resource.prlimit(attempt.pid, resource.RLIMIT_FSIZE, (limit, limit))


def _hang_up(attempt: Attempt) -> None:
    os.close(attempt.master)
    attempt.master = -1


WAYS: Mapping[str, tuple[Callable[[Attempt], None], tuple[int, ...]]] = {
    "sigterm": (lambda attempt: attempt.send(signal.SIGTERM), (*ENDED, *BEFORE)),
    "sighup": (lambda attempt: attempt.send(signal.SIGHUP), (*ENDED, *BEFORE)),
    "ctrl-c": (_once, (*ENDED, *BEFORE)),
    "ctrl-c-twice": (_twice, (*ENDED, *BEFORE)),
    "error": (lambda _: None, (*ENDED, 70)),
    "disk": (_fill_disk, (*ENDED, 2, *BEFORE)),
    "terminal": (_hang_up, (*ENDED, *BEFORE)),
    "service": (
        lambda attempt: attempt.send(signal.SIGTERM, signal.SIGCONT),
        (*ENDED, *BEFORE),
    ),
}


def _command(attempt: Attempt, target: str, way: str) -> list[str]:
    words = [sys.executable, "-m", "cellwright.engine.faces.cli"]
    if way == "error":
        words = [sys.executable, __file__, "--broken", str(attempt.chance.randrange(1, 90))]
    return [
        *words,
        "run",
        target,
        "--driver=external",
        f"--option=address=127.0.0.1:{attempt.cell.port}",
        f"--store={attempt.folder / 'runs.db'}",
        "--name=tried",
    ]


def _start(attempt: Attempt, target: str, way: str) -> None:
    surroundings = {**os.environ, "XDG_RUNTIME_DIR": str(attempt.folder)}
    surroundings.pop("NOTIFY_SOCKET", None)
    streams: dict[str, object] = {
        "stdin": subprocess.DEVNULL,
        "stdout": subprocess.DEVNULL,
        "stderr": subprocess.DEVNULL,
    }
    if way == "service":
        place = str(attempt.folder / "notify")
        attempt.manager = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        attempt.manager.bind(place)
        attempt.manager.setblocking(False)
        surroundings["NOTIFY_SOCKET"] = place
    slave = -1
    if way == "terminal":
        attempt.master, slave = pty.openpty()
        streams = {"stdin": slave, "stdout": slave, "stderr": slave}
        words = [sys.executable, __file__, "--terminal", *_command(attempt, target, way)]
        words += ["--watch"] if attempt.chance.random() < 0.5 else []
    else:
        words = _command(attempt, target, way)
    with (attempt.folder / "errors").open("wb") as errors:
        if way != "terminal":
            streams["stderr"] = errors
        attempt.process = subprocess.Popen(
            words,
            env=surroundings,
            start_new_session=True,
            **streams,  # type: ignore[call-overload]
        )
    if slave >= 0:
        os.close(slave)
        threading.Thread(target=_drain, args=(attempt,), daemon=True).start()


def _drain(attempt: Attempt) -> None:
    """Read what the terminal is written, so that it does not fill."""
    with suppress(OSError):
        while attempt.master >= 0 and os.read(attempt.master, 65536):
            pass


def try_way(problem: Problem, target: str, way: str, number: int, seed: int) -> tuple[str, str]:
    """How a run ended that was ended in a way at a random moment, and what is wrong."""
    chance = random.Random(f"{seed} {way} {number}")
    factor = 0.0 if number % 2 else 0.002
    lasts_s = 0.3 if number % 2 else 2.4
    with tempfile.TemporaryDirectory(prefix="ends") as name:
        attempt = Attempt(chance, ListeningCell(problem, factor), Path(name))
        _start(attempt, target, way)
        assert attempt.process is not None
        if chance.random() < 0.9:
            attempt.cell.greeted.wait(PATIENCE_S)
            time.sleep(chance.uniform(0, lasts_s))
        else:
            time.sleep(chance.uniform(0, 3))
        began = time.monotonic()
        WAYS[way][0](attempt)
        try:
            code = attempt.process.wait(PATIENCE_S)
        except subprocess.TimeoutExpired:
            attempt.process.kill()
            code = -9
        seconds = time.monotonic() - began
        attempt.cell.listener.close()
        if attempt.master >= 0:
            os.close(attempt.master)
        errors = (
            (attempt.folder / "errors").read_text("utf-8", "replace") if way != "terminal" else ""
        )
        wrong = _what_is_wrong(attempt, way, code, seconds)
        if attempt.manager is not None:
            attempt.manager.close()
        return f"exit {code}", wrong or ("a traceback" if "Traceback" in errors else "")


def _what_is_wrong(attempt: Attempt, way: str, code: int, seconds: float) -> str:
    heard = attempt.cell.heard
    if not attempt.cell.is_safe():
        return f"the controller heard neither quiesce nor halt: {heard[-6:]}, exit {code}"
    if attempt.told and attempt.told[0].startswith("nothing was heard"):
        return attempt.told[0]
    if code not in WAYS[way][1]:
        return f"exit {code}"
    if code in BEFORE and "hello" in heard:
        return f"exit {code} after the controller was greeted"
    if code == 40 and "halt" not in heard:
        return "a stop without halt"
    if way == "service" and seconds > SERVICE_S:
        return f"{seconds:.1f} s: a service manager would have killed it"
    if way == "service" and code == 40 and "STOPPING=1" not in attempt.states():
        return "the service manager was not told"
    return _damage(attempt.folder / "runs.db")


def _damage(store: Path) -> str:
    """What is wrong with the journal; empty if it is whole, or if the run never began."""
    if not store.exists():
        return ""
    try:
        with Journal(str(store)) as journal:
            if journal.run("tried") is not None:
                journal.require_whole("tried")
    except InvalidInput as error:
        return str(error.diagnostics[0].message)
    return ""


def run_broken(calls: int, words: list[str]) -> None:
    """The command line with an error of its own in the loop of a run."""
    from cellwright.engine.faces.cli.invocation import run_command_line
    from cellwright.engine.pipelines.execution.run_loop import RunLoop

    left = [calls]

    def breaking(function: Callable[..., object]) -> Callable[..., object]:
        def call(*arguments: object, **options: object) -> object:
            left[0] -= 1
            if left[0] == 0:
                raise ZeroDivisionError("broken on purpose")
            return function(*arguments, **options)

        return call

    for name in ("hear", "take", "flush", "wait", "dispatch", "ended", "result"):
        setattr(RunLoop, name, breaking(getattr(RunLoop, name)))
    sys.argv = ["cellwright", *words]
    run_command_line()


def take_terminal(words: list[str]) -> None:
    """Make standard input the terminal of this process, and become the command."""
    import fcntl
    import termios

    fcntl.ioctl(0, termios.TIOCSCTTY, 0)
    os.execv(words[0], words)


def main() -> int:
    """Print what came of each way; 1 if something is wrong."""
    if sys.argv[1:2] == ["--broken"]:
        run_broken(int(sys.argv[2]), sys.argv[3:])
    if sys.argv[1:2] == ["--terminal"]:
        take_terminal(sys.argv[2:])
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("ways", nargs="*", metavar="WAY", help=", ".join(WAYS))
    parser.add_argument("--times", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--kept", type=Path, help="what came of each, as lines of JSON")
    parser.add_argument("--target", default=TARGET)
    asked = parser.parse_args()
    ways, kept = asked.ways or list(WAYS), kept_results(asked.kept)
    for number in range(asked.times):
        for way in ways:
            if (way, number) not in kept:
                kept[way, number] = _tried(asked, way, number)
    for way in ways:
        results = [result for (which, _), result in kept.items() if which == way]
        counted = Counter(outcome for outcome, _ in results)
        wrong_count = sum(bool(wrong) for _, wrong in results)
        codes = ", ".join(f"{count} {outcome}" for outcome, count in sorted(counted.items()))
        print(f"{way:<14} {len(results):>4} moments, {wrong_count} wrong: {codes}")
    return int(any(wrong for _, wrong in kept.values()))


def _tried(asked: argparse.Namespace, way: str, number: int) -> tuple[str, str]:
    """The result of one attempt, which is told if it is wrong, and kept."""
    outcome, wrong = try_way(problem_of(asked.target), asked.target, way, number, asked.seed)
    if wrong:
        print(f"  {way} {number}: {wrong}", flush=True)
    if asked.kept:
        with asked.kept.open("a", encoding="utf-8") as file:
            file.write(json.dumps([way, number, outcome, wrong]) + "\n")
    return outcome, wrong


def kept_results(path: Path | None) -> dict[tuple[str, int], tuple[str, str]]:
    """What came of each attempt that was made before."""
    if path is None or not path.exists():
        return {}
    entries = map(json.loads, path.read_text("utf-8").splitlines())
    return {(way, number): (outcome, wrong) for way, number, outcome, wrong in entries}


if __name__ == "__main__":
    sys.exit(main())
