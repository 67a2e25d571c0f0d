"""What controllers do wrong, and what a run makes of it: it ends right, or stops safely.

    python benchmarks/misbehaviour.py [--kept FILE] [--target TARGET] [KIND ...]

KIND is one of those in KINDS; left out, all. Each is tried over TCP and over standard streams, with
a virtual clock and a real one. The run has a process of its own; it has to end within 30 s (where a
reply is missing on a real clock: 30 s behind the time limit of its command), with exit code 0, 1, 2
(refused before anything moves) or 40, without a traceback, and within 300 MB. What came of each is
kept in FILE: a campaign that was stopped goes on behind it. Exits with 1 if something is wrong.
"""

import argparse
import json
import os
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from cellwright.engine.model.run_protocol import Reply
from cellwright.engine.pipelines.execution.controllers.protocol import protocol_line, reply_entry
from cellwright.engine.pipelines.execution.controllers.reference_controller import (
    Conversation,
    ServedCell,
)
from cellwright.engine.pipelines.planning.checked_plan import problem_of
from cellwright.engine.ports import DriverSetup

TARGET = "themse/one"
LIMIT_S, LIMIT_MB = 30.0, 300.0
WAITED_S = 75.0  # where a reply is missing, and a real clock has to pass
RIGHT_CODES = (0, 1, 2, 40)
PACE = 0.002  # of a real clock
PLACES, CLOCKS = ("tcp", "streams"), ("virtual", "real")
Line = dict[str, Any]
Said = list[bytes] | None  # None hangs up
Manners = Callable[["Heard", list[bytes]], Said]


class Heard:
    """What a controller has heard: how many lines on all connections, and the last one."""

    def __init__(self) -> None:
        self.count, self.replies = 0, 0
        self.question: Line = {}
        self.kept: list[bytes] = []


def line(content: Mapping[str, Any]) -> bytes:
    """A line of JSON; Python writes NaN and Infinity as such."""
    return json.dumps(content).encode() + b"\n"


def changing(type_: str, **changes: Any) -> Manners:
    """Lines of a type with other values; `...` leaves a key out."""

    def change(_: Heard, lines: list[bytes]) -> Said:
        out = []
        for text in lines:
            content = json.loads(text)
            if content["type"] == type_:
                content = {
                    key: value for key, value in {**content, **changes}.items() if value is not ...
                }
            out.append(line(content))
        return out

    return change


def at_third(instead: Callable[[Line, "Heard"], list[bytes]]) -> Manners:
    """Something else in the place of the third reply."""

    def change(heard: Heard, lines: list[bytes]) -> Said:
        out: list[bytes] = []
        for text in lines:
            content = json.loads(text)
            heard.replies += content["type"] == "reply"
            is_third = content["type"] == "reply" and heard.replies == 3
            out += instead(content, heard) if is_third else [text]
        return out

    return change


def with_third(**changes: Any) -> Manners:
    """The third reply with other values, and then the right one."""
    return at_third(lambda content, _: [line({**content, **changes}), line(content)])


def after(count: int, said: Manners) -> Manners:
    """Good manners until so many lines were heard."""
    return lambda heard, lines: lines if heard.count <= count else said(heard, lines)


def flooding(piece: bytes) -> Manners:
    """A piece again and again, for ever, from the sixth line on."""
    block = piece * max(1, 65536 // len(piece))

    def flood(heard: Heard, lines: list[bytes]) -> Said:
        heard.kept[:] = [block]
        return lines

    return after(5, flood)


def raw_third(text: bytes) -> Manners:
    """Some bytes before the third reply."""
    return at_third(lambda content, _: [text, line(content)])


def parts(count: int, text: str, many_names: bool = False) -> Manners:
    """Parts before the third reply."""

    def pieces(content: Line, _: Heard) -> list[bytes]:
        return [
            line(
                {
                    "type": "part",
                    "number": content["number"],
                    "name": f"n{n}" if many_names else "n",
                    "text": text,
                }
            )
            for n in range(count)
        ] + [line(content)]

    return at_third(pieces)


def reversed_replies(_: Heard, lines: list[bytes]) -> Said:
    """Replies that come together, in the opposite order."""
    return [*reversed(lines[:-1]), *lines[-1:]]


def withheld(heard: Heard, lines: list[bytes]) -> Said:
    """Each reply comes with the one behind it, and behind that one."""
    replies = [text for text in lines if json.loads(text)["type"] == "reply"]
    others = [text for text in lines if text not in replies]
    now, heard.kept = heard.kept, replies
    return [*replies[1:], *now, *others] if replies else [*now, *others]


def creeping(heard: Heard, lines: list[bytes]) -> Said:
    """A clock that moves by a millisecond, and nothing ever ends."""
    if heard.question.get("type") != "advance":
        return lines
    heard.replies += 1
    return [line({"type": "advanced", "id": heard.question["id"], "now_ms": heard.replies})]


def standing(heard: Heard, lines: list[bytes]) -> Said:
    """A clock that stands still."""
    if heard.question.get("type") != "advance":
        return lines
    return [line({"type": "advanced", "id": heard.question["id"], "now_ms": 0})]


def every_other_hang_up(heard: Heard, lines: list[bytes]) -> Said:
    """It hangs up after every answer."""
    heard.kept[:] = [b""]
    return lines


TEXT_15_MIB = "x" * (15 * 2**20)
KINDS: Mapping[str, Manners] = {
    **{
        f"ready tick_ms {value!r}"[:40]: changing("ready", tick_ms=value)
        for value in (0, -1, 10**9, "x", True, float("nan"), 1.5, None)
    },
    **{
        f"ready now_ms {value!r}": changing("ready", now_ms=value)
        for value in (-1, 10**15, float("inf"), "0", float("nan"), None)
    },
    **{
        f"ready lookahead {value!r}": changing("ready", lookahead=value)
        for value in ({"default": 0}, {"default": True}, {"default": 10**12}, [], {"default": "4"})
    },
    "ready 20000 streams": changing("ready", lookahead={f"s{n}": 1 for n in range(20_000)}),
    **{
        f"ready version {value!r}": changing("ready", version=value)
        for value in (2, True, "1", None, float("nan"))
    },
    **{f"ready clock {value!r}": changing("ready", clock=value) for value in ("sundial", 5, ...)},
    "ready name of 1 MiB": changing("ready", name="n" * 2**20),
    "ready is no ready": changing("ready", type="welcome"),
    **{
        f"advanced now_ms {value!r}": changing("advanced", now_ms=value)
        for value in (-5, 0, 10**15, float("nan"), "x", ..., 10**9, 1.5)
    },
    "clock stands": standing,
    "clock creeps": creeping,
    **{
        f"reply at_ms {value!r}": with_third(at_ms=value)
        for value in (-1, 0, 10**15, float("nan"), "x", 1.5)
    },
    **{
        f"reply number {value!r}": with_third(number=value)
        for value in (-1, 10**12, True, "3", 1.5, 999, float("nan"))
    },
    **{
        f"reply text {str(value)[:12]!r}": with_third(text=value)
        for value in (5, None, "\ud800", ["done"])
    },
    "reply text of 15 MiB": with_third(text=TEXT_15_MIB),
    "reply text instead of 15 MiB": at_third(lambda c, _: [line({**c, "text": TEXT_15_MIB})]),
    "reply text nested": at_third(lambda c, _: [line({**c, "text": "f(" * 4000 + ")" * 4000})]),
    "reply text empty": at_third(lambda c, _: [line({**c, "text": ""})]),
    "reply text no term": at_third(lambda c, _: [line({**c, "text": ")(;%#\u0000"})]),
    "reply data NaN": with_third(data={"a": [{"b": float("nan")}]}),
    "reply data list": with_third(data=[1, 2]),
    "reply data 1e999": raw_third(
        b'{"type":"reply","number":3,"text":"done","data":{"a":1e999}}\n'
    ),
    "reply data long number": raw_third(b'{"type":"reply","number":3,"a":' + b"9" * 4000 + b"}\n"),
    "reply data deep": raw_third(b'{"type":"reply","data":' + b"[" * 10**6 + b"]" * 10**6 + b"}\n"),
    "reply data many lists": raw_third(
        b'{"type":"reply","data":[' + b"[]," * (5 * 10**6) + b"0]}\n"
    ),
    "reply data 390000 values": at_third(
        lambda c, _: [line({**c, "data": {"a": [1.5] * 390_000}})]
    ),
    "reply data of 15 MiB": at_third(lambda c, _: [line({**c, "data": {"a": TEXT_15_MIB}})]),
    "reply with an id": lambda heard, lines: [
        line({**json.loads(text), "id": heard.question.get("id", 0)}) for text in lines
    ],
    "reply with a text id": lambda _, lines: [
        line({"id": "x", **json.loads(text)}) for text in lines
    ],
    "replies twice": lambda _, lines: [
        text for given in lines for text in ([given] * (1 + (b'"reply"' in given)))
    ],
    "replies reversed": reversed_replies,
    "replies withheld": withheld,
    "reply missing": at_third(lambda _, __: []),
    "parts of 100 MiB": parts(100, "y" * 2**20),
    "parts of 20 MiB": parts(20, "y" * 2**20),
    "parts with 200000 names": parts(200_000, "y", many_names=True),
    "parts with wide characters": parts(20, "\U0001f600" * 2**18 + "y" * 2**20),
    "line of 20 MiB": raw_third(b"z" * (20 * 2**20) + b"\n"),
    "line of 60 MiB with lines in it": raw_third(b'{"type":"reply"' * (4 * 2**20) + b"\n"),
    "line of bytes": raw_third(bytes(range(256)) * 50 + b"\n"),
    "flood of garbage": flooding(b"garbage\n"),
    "flood of empty lines": flooding(b"\n"),
    "flood without a line": flooding(b"endless"),
    "flood of replies": flooding(b'{"type":"reply","number":77,"text":"done"}\n'),
    "flood of first replies": flooding(b'{"type":"reply","number":1,"text":"done"}\n'),
    "flood of parts": flooding(b'{"type":"part","number":77,"name":"n","text":"yyyyyyyy"}\n'),
    "flood of signs of life": flooding(b'{"type":"alive","id":0}\n'),
    "flood of answers": flooding(b'{"type":"advanced","id":1,"now_ms":5}\n'),
    "hangs up after each answer": every_other_hang_up,
    "hangs up at hello": lambda _, __: None,
    "hangs up at the sixth line": after(5, lambda _, __: None),
    "silent at hello": lambda _, __: [],
    "silent from the sixth line on": after(5, lambda _, __: []),
    "half a line, then silent": after(5, lambda _, lines: [b"".join(lines)[:10]]),
    "refuses all": after(
        3,
        lambda heard, _: [line({"type": "refused", "id": heard.question.get("id"), "why": "no"})],
    ),
    "answers another question": after(
        5, lambda heard, _: [line({"type": "halted", "id": heard.question.get("id")})]
    ),
    "answers with a text id": after(
        3, lambda _, lines: [line({**json.loads(text), "id": "1"}) for text in lines]
    ),
    "reports is no list": changing("reports", reports={"number": 1}),
    "reports a fate of its own": at_third(lambda _, __: []),
    "reports nothing": changing("reports", reports=[]),
}
MISSING = ("reply missing", "reports a fate of its own", "replies withheld", "reply text instead")


class MannerlyCell:
    """A simulated cell whose lines go through the manners of a kind."""

    def __init__(self, kind: str, clock: str, target: str) -> None:
        depth = {"lookahead": "4"} if kind.startswith("replies") else {}
        factor = PACE if clock == "real" else 0.0
        self.cell = ServedCell(DriverSetup(problem_of(target), "", 0, factor, depth))
        self.manners, self.floods = KINDS[kind], kind.startswith("flood")
        self.heard, self.pen = Heard(), threading.Lock()

    def converse(self, source: Iterable[bytes], write: Callable[[bytes], None]) -> None:
        """Answer one connection until it ends."""
        conversation, over = Conversation(self.cell), threading.Event()
        threading.Thread(target=self._tick, args=(over, write), daemon=True).start()
        with suppress(OSError, ValueError):
            for text in source:
                with self.pen:
                    self.heard.count += 1
                    self.heard.question = json.loads(text)
                    said = self.manners(self.heard, conversation.answers(text))
                if said is None:
                    break
                self._say(said, write)
                if self.heard.kept == [b""]:
                    break
        over.set()

    def _say(self, said: list[bytes], write: Callable[[bytes], None]) -> None:
        for text in said:
            write(text)
        while self.floods and self.heard.kept:
            write(self.heard.kept[0])

    def _tick(self, over: threading.Event, write: Callable[[bytes], None]) -> None:
        """Send what happens in real time."""
        with suppress(OSError, ValueError):
            while not over.wait(0.01):
                with self.pen:
                    came = [m for m in self.cell.elapsed() if isinstance(m, Reply)]
                    lines = [protocol_line("reply", **reply_entry(reply)) for reply in came]
                    for text in (self.manners(self.heard, lines) if lines else None) or []:
                        write(text)


def serve(cell: MannerlyCell, is_listening: bool) -> None:
    """Serve a cell on standard streams, or at an address whose port is printed."""
    if not is_listening:
        sink = os.dup(1)
        cell.converse(iter(sys.stdin.buffer.readline, b""), lambda text: _write_all(sink, text))
        return
    listener = socket.create_server(("127.0.0.1", 0))
    print(listener.getsockname()[1], flush=True)
    while True:
        peer, _ = listener.accept()
        with peer, suppress(OSError):
            cell.converse(peer.makefile("rb"), peer.sendall)


def _write_all(descriptor: int, text: bytes) -> None:
    while text:
        text = text[os.write(descriptor, text) :]


def try_kind(kind: str, place: str, clock: str, target: str) -> tuple[str, str]:
    """What came of a run with a controller that misbehaves, and what is wrong."""
    own = [sys.executable, __file__, "--serve", kind, "--clock", clock, "--target", target]
    with tempfile.TemporaryDirectory(prefix="odd") as name:
        folder, controller = Path(name), None
        if place == "tcp":
            controller = subprocess.Popen(
                [*own, "--listen"], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
            )
            assert controller.stdout is not None
            option = f"address=127.0.0.1:{controller.stdout.readline().decode().strip()}"
        else:
            command = folder / "controller.sh"
            quoted = " ".join(f"'{word}'" for word in own)
            command.write_text(f"#!/bin/sh\nexec {quoted} 2>/dev/null\n", "utf-8")
            option = f"command=sh {command}"
        try:
            return _run_beside(option, folder, target, _limit_s(kind, clock))
        finally:
            if controller is not None:
                controller.kill()
                controller.wait()


def _limit_s(kind: str, clock: str) -> float:
    waits = clock == "real" and kind.startswith(MISSING)
    return WAITED_S if waits else LIMIT_S


def _run_beside(option: str, folder: Path, target: str, limit_s: float) -> tuple[str, str]:
    """Run, and measure: exit code, seconds and megabytes; and what is wrong with them."""
    began, errors = time.monotonic(), folder / "errors"
    words = [sys.executable, "-m", "cellwright.engine.faces.cli", "run", target, "--name=odd"]
    words += ["--driver=external", f"--option={option}", f"--store={folder / 'runs.db'}"]
    surroundings = {**os.environ, "XDG_RUNTIME_DIR": str(folder)}
    with errors.open("wb") as file, (folder / "output").open("wb") as output:
        run = subprocess.Popen(
            words, env=surroundings, stdin=subprocess.DEVNULL, stdout=output, stderr=file
        )
        megabytes = _peak_megabytes(run, began + limit_s + 10)
    seconds = time.monotonic() - began
    outcome = f"exit {run.returncode} in {seconds:.1f} s, {megabytes:.0f} MB"
    wrong = []
    wrong += [] if run.returncode in RIGHT_CODES else [f"exit {run.returncode}"]
    wrong += [] if seconds <= limit_s else [f"{seconds:.0f} s"]
    wrong += [] if megabytes <= LIMIT_MB else [f"{megabytes:.0f} MB"]
    wrong += ["a traceback"] if "Traceback" in errors.read_text("utf-8", "replace") else []
    return outcome, "; ".join(wrong)


def _peak_megabytes(run: subprocess.Popen[bytes], latest: float) -> float:
    """The most memory that a process has had until it ended; it is killed if it does not."""
    peak = 0.0
    while run.poll() is None:
        with suppress(OSError, ValueError, IndexError):
            status = Path(f"/proc/{run.pid}/status").read_text("utf-8")
            peak = max(peak, int(status.split("VmHWM:")[1].split()[0]) / 1024)
        if time.monotonic() > latest:
            run.kill()
        time.sleep(0.02)
    return peak


def main() -> int:
    """Print what came of each kind; 1 if something is wrong."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("kinds", nargs="*", metavar="KIND")
    parser.add_argument("--kept", type=Path, help="what came of each, as lines of JSON")
    parser.add_argument("--target", default=TARGET)
    parser.add_argument("--serve", help=argparse.SUPPRESS)
    parser.add_argument("--clock", default="virtual", help=argparse.SUPPRESS)
    parser.add_argument("--listen", action="store_true", help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.serve:
        serve(MannerlyCell(asked.serve, asked.clock, asked.target), asked.listen)
        return 0
    kept = _kept_results(asked.kept)
    tried = [(k, p, c) for k in asked.kinds or KINDS for p in PLACES for c in CLOCKS]
    for case in tried:
        if case not in kept:
            outcome, wrong = kept[case] = try_kind(*case, asked.target)
            print(
                f"{', '.join(case):<56} {outcome} {'WRONG: ' + wrong if wrong else ''}", flush=True
            )
            if asked.kept:
                with asked.kept.open("a", encoding="utf-8") as file:
                    file.write(json.dumps([*case, outcome, wrong]) + "\n")
    wrong_count = sum(bool(kept[case][1]) for case in tried)
    print(f"{len(tried)} kinds, {wrong_count} wrong")
    return int(wrong_count > 0)


def _kept_results(path: Path | None) -> dict[tuple[str, str, str], tuple[str, str]]:
    if path is None or not path.exists():
        return {}
    entries = map(json.loads, path.read_text("utf-8").splitlines())
    return {
        (kind, place, clock): (outcome, wrong) for kind, place, clock, outcome, wrong in entries
    }


if __name__ == "__main__":
    sys.exit(main())
