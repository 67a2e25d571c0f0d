"""Log of a simulator as JSON lines: what it was told and did, so that it survives its process."""

import json
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TextIO

from cellwright.engine.model.run_protocol import CommandKind, DriverCommand
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.files import read_file

MAX_LOG_BYTES = 2**30  # bytes of a log that is read again
LOOK_KEYS = ("looks", "watches", "part")


@dataclass(frozen=True, slots=True)
class HandChange:
    """What a person has changed in the cell: facts that hold now, those that do not any more,
    and the stages reached then.
    """

    adds: tuple[str, ...]
    ends: tuple[str, ...]
    reached: Mapping[str, int]


@dataclass(frozen=True, slots=True)
class SentMessage:
    """What came from the executive at a time: commands, that everything halts, or what a person
    has done.
    """

    at_ms: int
    commands: tuple[DriverCommand, ...] = ()
    halted: bool = False
    hand: HandChange | None = None
    fence: int = 0


@dataclass
class SimulatorLog:
    """The log of a simulator.

    Without a file nothing is kept. What was written before is read once, by `past`.
    """

    file: str
    fence: int = field(default=0, init=False)  # the greatest fencing number that it knows
    _out: TextIO | None = field(default=None, init=False)
    _repeats: bool = field(default=False, init=False)

    def past(self) -> Iterator[SentMessage]:
        """What was sent before, in order; nothing is written while it is carried out again."""
        if not self.file:
            return
        self._repeats = True
        latest = 0
        if Path(self.file).is_file():
            for line, entry in _log_entries(Path(self.file)):
                try:
                    sent = _read_sent(entry)
                except (KeyError, TypeError, ValueError, AttributeError) as error:
                    raise _log_error(self.file, line, repr(error)) from None
                latest, self.fence = max(latest, sent.at_ms), max(self.fence, sent.fence)
                if sent.commands or sent.halted or sent.hand:
                    yield sent
            yield SentMessage(latest)
        self._repeats = False
        # open as long as the run, and only for its owner
        self._out = os.fdopen(
            os.open(self.file, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600), "a", encoding="utf-8"
        )
        self._out.write("\n" if latest else "")

    def sent(self, at_ms: int, commands: Sequence[DriverCommand]) -> None:
        """Commands came."""
        self._write({"at_ms": at_ms, "sent": [_command_entry(command) for command in commands]})

    def ended(self, at_ms: int, command: DriverCommand, reply: str | None) -> None:
        """A command was carried out."""
        self._write(
            {"at_ms": at_ms, "ended": command.number, "action": command.action, "reply": reply}
        )

    def fenced(self, at_ms: int, fence: int) -> None:
        """Somebody with a greater fencing number drives the cell."""
        self.fence = fence
        self._write({"at_ms": at_ms, "fence": fence})

    def halted(self, at_ms: int) -> None:
        """Everything was halted."""
        self._write({"at_ms": at_ms, "halted": True})

    def by_hand(self, at_ms: int, hand: HandChange) -> None:
        """A person has changed something."""
        self._write(
            {"at_ms": at_ms, "hand": [list(hand.adds), list(hand.ends), dict(hand.reached)]}
        )

    def _write(self, entry: dict[str, Any]) -> None:
        if self._out is not None and not self._repeats:
            self._out.write(json.dumps(entry) + "\n")
            self._out.flush()

    def close(self) -> None:
        """Close the file."""
        if self._out is not None:
            self._out.close()


def _log_entries(file: Path) -> Iterator[tuple[int, dict[str, Any]]]:
    """The entries of a log, each with its line; a line that was not written whole is left out.

    Raises `InvalidInput`.
    """
    for number, line in enumerate(read_file(file, most=MAX_LOG_BYTES).text.split("\n"), 1):
        try:
            yield number, json.loads(line)
        except RecursionError:
            raise _log_error(str(file), number, "nested too deeply") from None
        except ValueError:
            continue


def _log_error(file: str, line: int, said: str) -> InvalidInput:
    hint = "name another file, or remove this one: the simulator then begins anew"
    message = f"this is no log of a simulator: {said}"
    return InvalidInput([Diagnostic(Source(file, line), "K413", message[:300], hint)])


def _read_sent(entry: dict[str, Any]) -> SentMessage:
    """What an entry says; nothing was sent where a command ended."""
    at_ms, fence = entry["at_ms"], entry.get("fence", 0)
    if not isinstance(at_ms, int) or not isinstance(fence, int):
        raise TypeError(f"at_ms is {at_ms!r}, fence is {fence!r}")
    hand = _read_hand_change(*entry["hand"]) if "hand" in entry else None
    return SentMessage(
        at_ms, tuple(map(_read_command, entry.get("sent", ()))), "halted" in entry, hand, fence
    )


def _read_hand_change(adds: list[str], ends: list[str], reached: dict[str, int]) -> HandChange:
    wrong: list[object] = [fact for fact in (*adds, *ends) if not isinstance(fact, str)]
    wrong += [count for count in reached.values() if not isinstance(count, int)]
    if wrong:
        raise TypeError(f"a fact is {wrong[0]!r}")
    return HandChange(tuple(adds), tuple(ends), reached)


def _command_entry(command: DriverCommand) -> dict[str, Any]:
    looked = {key: value for key in LOOK_KEYS if (value := list(getattr(command, key)))}
    return looked | {
        "number": command.number,
        "kind": command.kind.value,
        "stream": command.stream,
        "action": command.action,
        "expects": command.expects,
        "choices": list(command.choices),
        "lasts_ms": command.lasts_ms,
        "about": command.about,
    }


def _read_command(entry: dict[str, Any]) -> DriverCommand:
    wrong = [key for key in ("number", "lasts_ms") if not isinstance(entry[key], int)]
    wrong += [key for key in ("stream", "action", "expects") if not isinstance(entry[key], str)]
    if wrong:
        raise TypeError(f"{wrong[0]} is {entry[wrong[0]]!r}")
    return DriverCommand(
        entry["number"],
        CommandKind(entry["kind"]),
        entry["stream"],
        entry["action"],
        expects=entry["expects"],
        choices=tuple(entry["choices"]),
        lasts_ms=entry["lasts_ms"],
        about=entry["about"],
        looks=tuple(entry.get("looks", ())),
        watches=tuple(entry.get("watches", ())),
        part=tuple(map(float, entry.get("part", ()))),
    )
