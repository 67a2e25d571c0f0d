"""The protocol between the executive and a controller in a process of its own: one JSON object a line (docs/drivers.md).

This module turns values into lines and lines into values. It neither waits nor reads a clock.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from cellwright.engine.model.execution import VERSION, Command, CommandKind, Fate, Reply, Report
from cellwright.kb.json_text import parsed

LONGEST = 16 * 1024 * 1024  # bytes of one line; more is sent in parts
ANSWERS = {
    "hello": "ready",
    "send": "taken",
    "advance": "advanced",
    "quiesce": "quiesced",
    "halt": "halted",
    "report": "reports",
    "ping": "alive",
}
"""What the executive asks, and the type of the line that answers it."""


class Garbage(Exception):
    """A line that is none of the protocol. The text says why."""


@dataclass(frozen=True, slots=True)
class Ready:
    """What a controller says of itself: its name and clock, its tick, and how many commands its devices queue."""

    name: str
    now_ms: int
    virtual: bool
    tick_ms: int | None
    lookahead: Mapping[str, int]


def line(type_: str, **content: Any) -> bytes:
    """A line of the protocol."""
    return (json.dumps({"type": type_, **content}, ensure_ascii=False) + "\n").encode("utf-8")


def hello(run: str) -> dict[str, Any]:
    """What the executive says first."""
    return {"version": VERSION, "run": run}


def read_line(text: bytes) -> dict[str, Any]:
    """The content of a line. Raises `Garbage`."""
    try:
        found = parsed(text.decode("utf-8"))
    except ValueError as error:
        raise Garbage(f"a line that is no JSON: {_short(text)}") from error
    if not isinstance(found, dict) or not isinstance(found.get("type"), str):
        raise Garbage(f"a line without a type: {_short(text)}")
    return found


def read_ready(found: Mapping[str, Any]) -> Ready:
    """What a controller says of itself. Raises `Garbage`."""
    if found.get("version") != VERSION:
        raise Garbage(f"the controller speaks version {found.get('version')} of the protocol, not {VERSION}")
    virtual = found.get("clock") == "virtual"
    tick = None if virtual else _whole(found, "tick_ms", 100)
    depths = found.get("lookahead", {})
    if not isinstance(depths, dict) or not all(
        isinstance(each, int) and each > 0 for each in depths.values()
    ):
        raise Garbage("`lookahead` needs a number of commands for each stream")
    return Ready(str(found.get("name", "")), _whole(found, "now_ms", 0), virtual, tick, depths)


def read_reply(found: Mapping[str, Any], now_ms: int) -> Reply:
    """A reply. Raises `Garbage`."""
    text, data = found.get("text"), found.get("data", {})
    if not isinstance(text, str) or not isinstance(data, dict):
        raise Garbage(f"a reply without a text: {_short(json.dumps(found).encode())}")
    return Reply(_whole(found, "number"), text, _whole(found, "at_ms", now_ms), data)


def read_reports(found: Mapping[str, Any], now_ms: int) -> list[Report]:
    """The fates of commands. Raises `Garbage`."""
    listed = found.get("reports")
    if not isinstance(listed, list) or not all(isinstance(each, dict) for each in listed):
        raise Garbage("`reports` is no list of fates")
    return [_report(each, now_ms) for each in listed]


def _report(each: Mapping[str, Any], now_ms: int) -> Report:
    try:
        fate = Fate(str(each.get("fate")))
    except ValueError:
        raise Garbage(f"no fate of a command: {each.get('fate')}") from None
    number = _whole(each, "number")
    reply = (
        read_reply({**each["reply"], "number": number}, now_ms)
        if isinstance(each.get("reply"), dict)
        else None
    )
    if fate is Fate.ENDED and reply is None:
        raise Garbage(f"command {number} has ended, and its reply is missing")
    return Report(number, fate, reply)


def report_entry(report: Report) -> dict[str, Any]:
    """A fate as JSON."""
    found: dict[str, Any] = {"number": report.number, "fate": report.fate.value}
    return found if report.reply is None else {**found, "reply": reply_entry(report.reply)}


def reply_entry(reply: Reply) -> dict[str, Any]:
    """A reply as JSON."""
    found: dict[str, Any] = {"number": reply.number, "text": reply.text, "at_ms": reply.at_ms}
    return {**found, "data": dict(reply.data)} if reply.data else found


def command_entry(command: Command) -> dict[str, Any]:
    """A command as JSON. What is not said is left out."""
    found = {
        "number": command.number,
        "kind": command.kind.value,
        "stream": command.stream,
        "action": command.action,
        "says": command.says,
        "expects": command.expects,
        "choices": list(command.choices),
        "lasts_ms": command.lasts_ms,
        "timeout_ms": command.timeout_ms,
        "about": command.about,
        "asks": command.asks,
        "looks": list(command.looks),
        "watches": list(command.watches),
        "part": list(command.part),
    }
    return {key: value for key, value in found.items() if value not in (None, "", [], False)}


def read_command(found: Mapping[str, Any]) -> Command:
    """A command. Raises `Garbage`."""
    try:
        return Command(
            _whole(found, "number"),
            CommandKind(found["kind"]),
            str(found["stream"]),
            str(found["action"]),
            str(found.get("says", "")),
            str(found.get("expects", "done")),
            tuple(map(str, found.get("choices", ()))),
            _whole(found, "lasts_ms", 0),
            _whole(found, "timeout_ms") if found.get("timeout_ms") is not None else None,
            _whole(found, "about") if found.get("about") is not None else None,
            bool(found.get("asks", False)),
            tuple(map(str, found.get("looks", ()))),
            tuple(map(str, found.get("watches", ()))),
            tuple(map(float, found.get("part", ()))),
        )
    except (KeyError, ValueError, TypeError) as error:
        raise Garbage(f"no command: {error}") from error


def read_commands(found: Mapping[str, Any]) -> Sequence[Command]:
    """The commands that are sent. Raises `Garbage`."""
    listed = found.get("commands")
    if not isinstance(listed, list) or not all(isinstance(each, dict) for each in listed):
        raise Garbage("`commands` is no list")
    return [read_command(each) for each in listed]


def _whole(found: Mapping[str, Any], key: str, otherwise: int | None = None) -> int:
    value = found.get(key, otherwise)
    if not isinstance(value, int) or isinstance(value, bool):
        raise Garbage(f"`{key}` is no whole number: {_short(json.dumps(value).encode())}")
    return value


def _short(text: bytes) -> str:
    said = text.decode("utf-8", "replace").strip()
    return said if len(said) <= 80 else f"{said[:77]}..."
