"""What a simulated cell was told and what it did, one JSON object a line, so that it survives the process that it lives in."""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TextIO

from cellwright.engine.model.execution import Command, CommandKind
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.files import read_file

LARGEST = 2**30  # bytes of a log that is read again
LOOKED = ("looks", "watches", "part")


@dataclass(frozen=True, slots=True)
class Hand:
    """What a person has changed in the cell: facts that hold now, those that do not any more, and the stages reached then."""

    adds: tuple[str, ...]
    ends: tuple[str, ...]
    reached: Mapping[str, int]


@dataclass(frozen=True, slots=True)
class Sent:
    """What came from the executive at a time: commands, that everything halts, or what a person has done."""

    at_ms: int
    commands: tuple[Command, ...] = ()
    halted: bool = False
    hand: Hand | None = None


@dataclass
class Log:
    """The log of a simulator. Without a file nothing is kept. What was written before is read once, by `past`."""

    file: str
    _out: TextIO | None = field(default=None, init=False)
    _repeats: bool = field(default=False, init=False)

    def past(self) -> Iterator[Sent]:
        """What was sent before, in order; nothing is written while it is carried out again."""
        if not self.file:
            return
        self._repeats = True
        latest = 0
        if Path(self.file).is_file():
            for line, entry in _entries(Path(self.file)):
                try:
                    sent = _sent(entry)
                except (KeyError, TypeError, ValueError, AttributeError) as error:
                    raise _refused(self.file, line, repr(error)) from None
                latest = max(latest, sent.at_ms)
                if sent.commands or sent.halted or sent.hand:
                    yield sent
            yield Sent(latest)
        self._repeats = False
        self._out = Path(self.file).open("a", encoding="utf-8")  # noqa: SIM115 - open as long as the run
        self._out.write("\n" if latest else "")

    def sent(self, at_ms: int, commands: Sequence[Command]) -> None:
        """Commands came."""
        self._write({"at_ms": at_ms, "sent": [_entry(each) for each in commands]})

    def ended(self, at_ms: int, command: Command, reply: str | None) -> None:
        """A command was carried out."""
        self._write({"at_ms": at_ms, "ended": command.number, "action": command.action, "reply": reply})

    def halted(self, at_ms: int) -> None:
        """Everything was halted."""
        self._write({"at_ms": at_ms, "halted": True})

    def by_hand(self, at_ms: int, hand: Hand) -> None:
        """A person has changed something."""
        self._write({"at_ms": at_ms, "hand": [list(hand.adds), list(hand.ends), dict(hand.reached)]})

    def _write(self, entry: dict[str, Any]) -> None:
        if self._out is not None and not self._repeats:
            self._out.write(json.dumps(entry) + "\n")
            self._out.flush()

    def close(self) -> None:
        """Close the file."""
        if self._out is not None:
            self._out.close()


def _entries(file: Path) -> Iterator[tuple[int, dict[str, Any]]]:
    """The entries of a log, each with its line; a line that was not written whole is left out. Raises `InvalidInput`."""
    for number, line in enumerate(read_file(file, most=LARGEST).text.split("\n"), 1):
        try:
            yield number, json.loads(line)
        except RecursionError:
            raise _refused(str(file), number, "nested too deeply") from None
        except ValueError:
            continue


def _refused(file: str, line: int, said: str) -> InvalidInput:
    hint = "name another file, or remove this one: the simulator then begins anew"
    message = f"this is no log of a simulator: {said}"
    return InvalidInput([Diagnostic(Source(file, line), "K413", message[:300], hint)])


def _sent(entry: dict[str, Any]) -> Sent:
    """What an entry says; nothing was sent where a command ended."""
    at_ms = entry["at_ms"]
    if not isinstance(at_ms, int):
        raise TypeError(f"at_ms is {at_ms!r}")
    hand = _hand(*entry["hand"]) if "hand" in entry else None
    return Sent(at_ms, tuple(map(_command, entry.get("sent", ()))), "halted" in entry, hand)


def _hand(adds: list[str], ends: list[str], reached: dict[str, int]) -> Hand:
    wrong: list[object] = [each for each in (*adds, *ends) if not isinstance(each, str)]
    wrong += [each for each in reached.values() if not isinstance(each, int)]
    if wrong:
        raise TypeError(f"a fact is {wrong[0]!r}")
    return Hand(tuple(adds), tuple(ends), reached)


def _entry(command: Command) -> dict[str, Any]:
    looked = {key: value for key in LOOKED if (value := list(getattr(command, key)))}
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


def _command(entry: dict[str, Any]) -> Command:
    wrong = [key for key in ("number", "lasts_ms") if not isinstance(entry[key], int)]
    wrong += [key for key in ("stream", "action", "expects") if not isinstance(entry[key], str)]
    if wrong:
        raise TypeError(f"{wrong[0]} is {entry[wrong[0]]!r}")
    return Command(
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
