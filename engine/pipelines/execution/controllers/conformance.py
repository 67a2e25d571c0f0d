"""Conformance test for makers of controllers: whether one keeps the protocol, point by point.

It carries out the first steps of a plan, so it belongs in a cell where nothing can be hurt, or
before a simulated one.
"""

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

from cellwright.engine.model.run_protocol import DriverCommand, Fate, Reply
from cellwright.engine.pipelines.execution.controllers.link import (
    ControllerAddress,
    ControllerConnected,
    ControllerLink,
    NoAnswer,
    Patience,
    patience_of,
    place_of,
)
from cellwright.engine.pipelines.execution.controllers.protocol import (
    ANSWER_OF_QUESTION,
    MalformedLine,
    command_entry,
    hello_content,
    newer_fence,
    read_ready,
)
from cellwright.engine.pipelines.execution.controllers.remote_driver import ControllerDriver
from cellwright.engine.ports import DriverSetup
from cellwright.kb.diagnostics import InvalidInput

CONFORMANCE_STEPS = 3  # commands that are carried out


class ProtocolViolation(Exception):
    """The controller does not do what the protocol says. The text says what it did."""


@dataclass(frozen=True, slots=True)
class CheckedPoint:
    """A point of the protocol, and what the controller did wrong there; empty if nothing."""

    point: str
    wrong: str = ""


def check_conformance(setup: DriverSetup, commands: Sequence[DriverCommand]) -> list[CheckedPoint]:
    """What a controller makes of each point of the protocol.

    Raises `InvalidInput` for options that name none.
    """
    place, patience = place_of(setup.options), patience_of(setup.options)
    setup = setup if setup.fence else replace(setup, fence=int(time.time()))
    return list(_protocol_points(place, patience, setup, commands[:CONFORMANCE_STEPS]))


def _protocol_points(
    place: ControllerAddress,
    patience: Patience,
    setup: DriverSetup,
    commands: Sequence[DriverCommand],
) -> Iterator[CheckedPoint]:
    yield _check_point(
        "refuses another version of the protocol",
        lambda: _refuses_nonsense(place, patience, setup.run),
    )
    yield _check_point(
        "answers each question, and survives garbage",
        lambda: _answers_questions(place, patience, setup.run, setup.fence),
    )
    try:
        driver = ControllerDriver(place, patience, setup.run, setup.fence)
    except InvalidInput as error:
        yield CheckedPoint("greets the driver", error.diagnostics[0].message)
        return
    try:
        yield CheckedPoint("greets the driver")
        yield _check_point(
            "knows nothing of commands that were never sent",
            lambda: _reports_unknown(driver, commands),
        )
        yield from _carried_out(driver, commands)
        yield _check_point("quiesces", lambda: _ignore_answer(driver.quiesce(1000)))
        yield _check_point("halts", driver.halt)
    finally:
        driver.close()
    if not place.command:
        yield _check_point(
            "knows its commands after a reconnection",
            lambda: _remembers_commands(place, patience, setup, commands),
        )
        yield _check_point(
            "refuses an older fencing number",
            lambda: _refuses_older_fence(place, patience, setup.run, setup.fence - 1),
        )


def _check_point(point_text: str, do: Callable[[], None]) -> CheckedPoint:
    try:
        do()
    except (ProtocolViolation, MalformedLine, NoAnswer) as error:
        return CheckedPoint(point_text, str(error))
    except InvalidInput as error:
        return CheckedPoint(point_text, error.diagnostics[0].message)
    return CheckedPoint(point_text)


def _ignore_answer(_: object) -> None:
    return None


def _carried_out(
    driver: ControllerDriver, commands: Sequence[DriverCommand]
) -> Iterator[CheckedPoint]:
    """Each command is answered once, as the domain expects, and is not carried out again."""
    for command in commands:
        yield _check_point(
            f"carries out {command.action} and replies once",
            partial(_replies_once, driver, command),
        )
    yield _check_point(
        "does not carry out a command twice", lambda: _executes_once(driver, commands)
    )


def _refuses_older_fence(
    place: ControllerAddress, patience: Patience, run: str, fence: int
) -> None:
    link = _open_link(place, patience, fence)
    try:
        for type_, content in (("hello", hello_content(run)), ("halt", {})):
            answer = link.ask(type_, **content)
            if answer["type"] != "refused":
                raise ProtocolViolation(f"it obeys `{type_}` of a host with an older one")
            if newer_fence(answer, fence) is None:
                raise ProtocolViolation("its `refused` does not say `fence`, the newer number")
    finally:
        link.close()


def _open_link(place: ControllerAddress, patience: Patience, fence: int = 0) -> ControllerLink:
    link = ControllerLink(place, patience, fence)
    event = link.inbox.get(timeout=patience.answer_s + patience.reconnect_s + 1)
    if not isinstance(event, ControllerConnected):
        link.close()
        raise ProtocolViolation(f"it cannot be reached: {getattr(event, 'why', '')}")
    return link


def _refuses_nonsense(place: ControllerAddress, patience: Patience, run: str) -> None:
    link = _open_link(place, patience)
    try:
        answer = link.ask("hello", **{**hello_content(run), "version": 0})
        if answer["type"] != "refused":
            raise ProtocolViolation("it answers `hello` in version 0 as if it knew it")
    finally:
        link.close()


def _answers_questions(place: ControllerAddress, patience: Patience, run: str, fence: int) -> None:
    link = _open_link(place, patience, fence)
    try:
        ready = read_ready(_ask_controller(link, "hello", hello_content(run)))
        link.say(b"this is no JSON\n")
        _ask_controller(link, "ping", {})
        _ask_controller(link, "report", {"numbers": []})
        if ready.virtual:
            _ask_controller(link, "advance", {"until_ms": ready.now_ms})
    finally:
        link.close()


def _ask_controller(link: ControllerLink, type_: str, content: dict[str, Any]) -> dict[str, Any]:
    answer = link.ask(type_, **content)
    if answer["type"] != ANSWER_OF_QUESTION[type_]:
        raise ProtocolViolation(
            f"it answers `{type_}` with `{answer['type']}`: {answer.get('why', '')}"
        )
    return answer


def _reports_unknown(driver: ControllerDriver, commands: Sequence[DriverCommand]) -> None:
    numbers = [command.number for command in commands]
    for report in driver.report(numbers):
        if report.fate is not Fate.UNKNOWN:
            raise ProtocolViolation(
                f"it says that command {report.number}, which was never sent, is "
                f"{report.fate.value}"
            )


def _replies_once(driver: ControllerDriver, command: DriverCommand) -> None:
    driver.send([command])
    end = time.monotonic() + (command.timeout_ms or 60_000) / 1000
    replies: list[Reply] = []
    while not replies and time.monotonic() < end:
        for message in driver.receive(
            None if driver.tick_ms is None else driver.now_ms() + driver.tick_ms
        ):
            if not isinstance(message, Reply):
                raise ProtocolViolation(f"{message.kind.value}: {message.text}")
            replies.append(message)
        if driver.tick_ms is None and not replies:
            break
    if [reply.number for reply in replies] != [command.number]:
        raise ProtocolViolation("no reply came")


def _executes_once(driver: ControllerDriver, commands: Sequence[DriverCommand]) -> None:
    before = driver.report([command.number for command in commands])
    driver.link.ask("send", commands=[command_entry(command) for command in commands])
    until = None if driver.tick_ms is None else driver.now_ms() + 5 * driver.tick_ms
    if came := driver.receive(until):
        raise ProtocolViolation(
            f"it says something of a command that was sent again: {came[0].text}"
        )
    if driver.report([command.number for command in commands]) != before:
        raise ProtocolViolation("its reports of commands change when they are sent again")


def _remembers_commands(
    place: ControllerAddress,
    patience: Patience,
    setup: DriverSetup,
    commands: Sequence[DriverCommand],
) -> None:
    driver = ControllerDriver(place, patience, setup.run, setup.fence)
    try:
        for report in driver.report([command.number for command in commands]):
            if report.fate is not Fate.ENDED:
                raise ProtocolViolation(
                    f"command {report.number} had ended, and now it is {report.fate.value}"
                )
    finally:
        driver.close()
