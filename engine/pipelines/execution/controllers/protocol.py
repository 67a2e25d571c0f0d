"""Protocol between the executive and a controller process: one JSON object a line.

This module turns values into lines and lines into values. It neither waits nor reads a clock.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from cellwright.engine.model.run_protocol import (
    PROTOCOL_VERSION,
    CommandKind,
    DriverCommand,
    Fate,
    Reply,
    Report,
)
from cellwright.kb.json_text import parse_json

MAX_LINE_BYTES = 16 * 1024 * 1024  # bytes of one line; more is sent in parts
ANSWER_OF_QUESTION = {
    "hello": "ready",
    "send": "taken",
    "advance": "advanced",
    "quiesce": "quiesced",
    "halt": "halted",
    "report": "reports",
    "ping": "alive",
}
"""What the executive asks, and the type of the line that answers it."""


class MalformedLine(Exception):
    """A line that is none of the protocol. The text says why."""


@dataclass(frozen=True, slots=True)
class ControllerReady:
    """What a controller says of itself: its name and clock, its tick, and how many commands its
    devices queue.
    """

    name: str
    now_ms: int
    virtual: bool
    tick_ms: int | None
    lookahead: Mapping[str, int]


def protocol_line(type_: str, **content: Any) -> bytes:
    """A line of the protocol."""
    return (json.dumps({"type": type_, **content}, ensure_ascii=False) + "\n").encode("utf-8")


def hello_content(run: str) -> dict[str, Any]:
    """What the executive says first."""
    return {"version": PROTOCOL_VERSION, "run": run}


def read_line(text: bytes) -> dict[str, Any]:
    """The content of a line. Raises `MalformedLine`."""
    try:
        message = parse_json(text.decode("utf-8"))
    except ValueError as error:
        raise MalformedLine(f"a line that is no JSON: {_short_text(text)}") from error
    if not isinstance(message, dict) or not isinstance(message.get("type"), str):
        raise MalformedLine(f"a line without a type: {_short_text(text)}")
    return message


def read_ready(content: Mapping[str, Any]) -> ControllerReady:
    """What a controller says of itself. Raises `MalformedLine`."""
    if content.get("version") != PROTOCOL_VERSION:
        raise MalformedLine(
            f"the controller speaks version {content.get('version')} of the protocol, not "
            f"{PROTOCOL_VERSION}"
        )
    virtual = content.get("clock") == "virtual"
    tick = None if virtual else _whole_number(content, "tick_ms", 100)
    depths = content.get("lookahead", {})
    if not isinstance(depths, dict) or not all(
        isinstance(depth, int) and depth > 0 for depth in depths.values()
    ):
        raise MalformedLine("`lookahead` needs a number of commands for each stream")
    return ControllerReady(
        str(content.get("name", "")), _whole_number(content, "now_ms", 0), virtual, tick, depths
    )


def read_reply(content: Mapping[str, Any], now_ms: int) -> Reply:
    """A reply. Raises `MalformedLine`."""
    text, data = content.get("text"), content.get("data", {})
    if not isinstance(text, str) or not isinstance(data, dict):
        raise MalformedLine(f"a reply without a text: {_short_text(json.dumps(content).encode())}")
    return Reply(
        _whole_number(content, "number"), text, _whole_number(content, "at_ms", now_ms), data
    )


def read_reports(content: Mapping[str, Any], now_ms: int) -> list[Report]:
    """The fates of commands. Raises `MalformedLine`."""
    listed = content.get("reports")
    if not isinstance(listed, list) or not all(isinstance(report, dict) for report in listed):
        raise MalformedLine("`reports` is no list of fates")
    return [_read_report(report, now_ms) for report in listed]


def _read_report(content: Mapping[str, Any], now_ms: int) -> Report:
    try:
        fate = Fate(str(content.get("fate")))
    except ValueError:
        raise MalformedLine(f"no fate of a command: {content.get('fate')}") from None
    number = _whole_number(content, "number")
    reply = (
        read_reply({**content["reply"], "number": number}, now_ms)
        if isinstance(content.get("reply"), dict)
        else None
    )
    if fate is Fate.ENDED and reply is None:
        raise MalformedLine(f"command {number} has ended, and its reply is missing")
    return Report(number, fate, reply)


def report_entry(report: Report) -> dict[str, Any]:
    """A fate as JSON."""
    entry: dict[str, Any] = {"number": report.number, "fate": report.fate.value}
    return entry if report.reply is None else {**entry, "reply": reply_entry(report.reply)}


def reply_entry(reply: Reply) -> dict[str, Any]:
    """A reply as JSON."""
    entry: dict[str, Any] = {"number": reply.number, "text": reply.text, "at_ms": reply.at_ms}
    return {**entry, "data": dict(reply.data)} if reply.data else entry


def command_entry(command: DriverCommand) -> dict[str, Any]:
    """A command as JSON. What is not said is left out."""
    entry = {
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
    return {key: value for key, value in entry.items() if value not in (None, "", [], False)}


def read_command(content: Mapping[str, Any]) -> DriverCommand:
    """A command. Raises `MalformedLine`."""
    try:
        return DriverCommand(
            _whole_number(content, "number"),
            CommandKind(content["kind"]),
            str(content["stream"]),
            str(content["action"]),
            str(content.get("says", "")),
            str(content.get("expects", "done")),
            tuple(map(str, content.get("choices", ()))),
            _whole_number(content, "lasts_ms", 0),
            _whole_number(content, "timeout_ms") if content.get("timeout_ms") is not None else None,
            _whole_number(content, "about") if content.get("about") is not None else None,
            bool(content.get("asks", False)),
            tuple(map(str, content.get("looks", ()))),
            tuple(map(str, content.get("watches", ()))),
            tuple(map(float, content.get("part", ()))),
        )
    except (KeyError, ValueError, TypeError) as error:
        raise MalformedLine(f"no command: {error}") from error


def read_commands(content: Mapping[str, Any]) -> Sequence[DriverCommand]:
    """The commands that are sent. Raises `MalformedLine`."""
    listed = content.get("commands")
    if not isinstance(listed, list) or not all(isinstance(command, dict) for command in listed):
        raise MalformedLine("`commands` is no list")
    return [read_command(command) for command in listed]


def _whole_number(content: Mapping[str, Any], key: str, otherwise: int | None = None) -> int:
    value = content.get(key, otherwise)
    if not isinstance(value, int) or isinstance(value, bool):
        raise MalformedLine(
            f"`{key}` is no whole number: {_short_text(json.dumps(value).encode())}"
        )
    return value


def _short_text(text: bytes) -> str:
    shown = text.decode("utf-8", "replace").strip()
    return shown if len(shown) <= 80 else f"{shown[:77]}..."
