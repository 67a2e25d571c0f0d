"""The conformance test for makers of controllers: whether a controller keeps the protocol, point by point.

It carries out the first steps of a plan, so it belongs in a cell where nothing can be hurt, or before a simulated one.
"""

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from cellwright.engine.model.execution import Command, Fate, Reply
from cellwright.engine.pipelines.controllers.driver import ControllerDriver
from cellwright.engine.pipelines.controllers.link import Connected, Link, NoAnswer, Patience, Place
from cellwright.engine.pipelines.controllers.protocol import (
    ANSWERS,
    Garbage,
    command_entry,
    hello,
    read_ready,
)
from cellwright.engine.pipelines.controllers.settings import patience_of, place_of
from cellwright.engine.ports import DriverSetup
from cellwright.kb.diagnostics import InvalidInput

STEPS = 3  # commands that are carried out


class Wrong(Exception):
    """The controller does not do what the protocol says. The text says what it did."""


@dataclass(frozen=True, slots=True)
class Checked:
    """A point of the protocol, and what the controller did wrong there; empty if nothing."""

    point: str
    wrong: str = ""


def checked(setup: DriverSetup, commands: Sequence[Command]) -> list[Checked]:
    """What a controller makes of each point of the protocol. Raises `InvalidInput` for options that name none."""
    place, patience = place_of(setup.options), patience_of(setup.options)
    return list(_points(place, patience, setup, commands[:STEPS]))


def _points(
    place: Place, patience: Patience, setup: DriverSetup, commands: Sequence[Command]
) -> Iterator[Checked]:
    yield _point("refuses another version of the protocol", lambda: _refuses(place, patience, setup.run))
    yield _point("answers each question, and survives garbage", lambda: _answers(place, patience, setup.run))
    try:
        driver = ControllerDriver(place, patience, setup.run)
    except InvalidInput as error:
        yield Checked("greets the driver", error.diagnostics[0].message)
        return
    try:
        yield Checked("greets the driver")
        yield _point("knows nothing of commands that were never sent", lambda: _unknown(driver, commands))
        yield from _carried_out(driver, commands)
        yield _point("quiesces", lambda: _none(driver.quiesce(1000)))
        yield _point("halts", driver.halt)
    finally:
        driver.close()
    if not place.command:
        yield _point(
            "knows its commands after a reconnection", lambda: _again(place, patience, setup.run, commands)
        )


def _point(said: str, do: Callable[[], None]) -> Checked:
    try:
        do()
    except (Wrong, Garbage, NoAnswer) as error:
        return Checked(said, str(error))
    except InvalidInput as error:
        return Checked(said, error.diagnostics[0].message)
    return Checked(said)


def _none(_: object) -> None:
    return None


def _carried_out(driver: ControllerDriver, commands: Sequence[Command]) -> Iterator[Checked]:
    """Each command is answered once, as the domain expects, and is not carried out again."""
    for each in commands:
        yield _point(f"carries out {each.action} and replies once", partial(_replies, driver, each))
    yield _point("does not carry out a command twice", lambda: _once(driver, commands))


def _linked(place: Place, patience: Patience) -> Link:
    link = Link(place, patience)
    event = link.inbox.get(timeout=patience.answer_s + patience.reconnect_s + 1)
    if not isinstance(event, Connected):
        link.close()
        raise Wrong(f"it cannot be reached: {getattr(event, 'why', '')}")
    return link


def _refuses(place: Place, patience: Patience, run: str) -> None:
    link = _linked(place, patience)
    try:
        answer = link.ask("hello", **{**hello(run), "version": 0})
        if answer["type"] != "refused":
            raise Wrong("it answers `hello` in version 0 as if it knew it")
    finally:
        link.close()


def _answers(place: Place, patience: Patience, run: str) -> None:
    link = _linked(place, patience)
    try:
        ready = read_ready(_asked(link, "hello", hello(run)))
        link.say(b"this is no JSON\n")
        _asked(link, "ping", {})
        _asked(link, "report", {"numbers": []})
        if ready.virtual:
            _asked(link, "advance", {"until_ms": ready.now_ms})
    finally:
        link.close()


def _asked(link: Link, type_: str, content: dict[str, Any]) -> dict[str, Any]:
    answer = link.ask(type_, **content)
    if answer["type"] != ANSWERS[type_]:
        raise Wrong(f"it answers `{type_}` with `{answer['type']}`: {answer.get('why', '')}")
    return answer


def _unknown(driver: ControllerDriver, commands: Sequence[Command]) -> None:
    numbers = [each.number for each in commands]
    for each in driver.report(numbers):
        if each.fate is not Fate.UNKNOWN:
            raise Wrong(f"it says that command {each.number}, which was never sent, is {each.fate.value}")


def _replies(driver: ControllerDriver, command: Command) -> None:
    driver.send([command])
    end = time.monotonic() + (command.timeout_ms or 60_000) / 1000
    replies: list[Reply] = []
    while not replies and time.monotonic() < end:
        for message in driver.receive(None if driver.tick_ms is None else driver.now_ms() + driver.tick_ms):
            if not isinstance(message, Reply):
                raise Wrong(f"{message.kind.value}: {message.text}")
            replies.append(message)
        if driver.tick_ms is None and not replies:
            break
    if [each.number for each in replies] != [command.number]:
        raise Wrong("no reply came")


def _once(driver: ControllerDriver, commands: Sequence[Command]) -> None:
    before = driver.report([each.number for each in commands])
    driver.link.ask("send", commands=[command_entry(each) for each in commands])
    until = None if driver.tick_ms is None else driver.now_ms() + 5 * driver.tick_ms
    if came := driver.receive(until):
        raise Wrong(f"it says something of a command that was sent again: {came[0].text}")
    if driver.report([each.number for each in commands]) != before:
        raise Wrong("its reports of commands change when they are sent again")


def _again(place: Place, patience: Patience, run: str, commands: Sequence[Command]) -> None:
    driver = ControllerDriver(place, patience, run)
    try:
        for each in driver.report([each.number for each in commands]):
            if each.fate is not Fate.ENDED:
                raise Wrong(f"command {each.number} had ended, and now it is {each.fate.value}")
    finally:
        driver.close()
