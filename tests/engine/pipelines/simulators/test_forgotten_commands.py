"""A simulated cell forgets old commands, and still carries none out a second time."""

from collections.abc import Sequence

import pytest

from cellwright.engine.model.run_protocol import CommandKind, DriverCommand, Fate, Message
from cellwright.engine.pipelines.simulators import virtual_clock
from cellwright.engine.pipelines.simulators.simulator_settings import SimulatorSettings
from cellwright.engine.pipelines.simulators.virtual_clock import Simulator

KEPT = 10


class Counting:
    """A cell that counts how often each action is taken."""

    def __init__(self) -> None:
        self.taken: list[str] = []

    def missing(self, _facts: Sequence[str]) -> str:
        return ""

    def told(self) -> dict[str, str]:
        return {}

    def take(self, action: str, _expects: str, _part: Sequence[float]) -> str:
        self.taken.append(action)
        return "done"


@pytest.fixture
def cell(monkeypatch: pytest.MonkeyPatch) -> Counting:
    monkeypatch.setattr(virtual_clock, "MAX_REMEMBERED_COMMANDS", KEPT)
    return Counting()


def step(number: int, stream: str = "arm") -> DriverCommand:
    return DriverCommand(number, CommandKind.STEP, stream, f"step({number})", lasts_ms=10)


def carried_out(made: Simulator, commands: Sequence[DriverCommand]) -> list[Message]:
    came = []
    for each in commands:
        made.send([each])
        came += made.receive(None)
    return came


def test_only_the_last_commands_are_remembered_and_none_is_repeated(cell: Counting) -> None:
    made, steps = Simulator(cell), [step(number) for number in range(1, 101)]
    assert len(carried_out(made, steps)) == 100
    assert len(made._commands) <= 2 * KEPT + 1
    assert len(made._ended) <= 2 * KEPT + 1
    assert carried_out(made, steps) == []
    assert cell.taken == [each.action for each in steps]
    assert [each.fate for each in made.report([1, 100, 101])] == [
        Fate.ENDED,
        Fate.ENDED,
        Fate.UNKNOWN,
    ]


def test_a_wait_that_stands_in_a_queue_is_not_forgotten(cell: Counting) -> None:
    made = Simulator(cell, SimulatorSettings(lookahead=4))
    made.send([DriverCommand(1, CommandKind.WAIT, "oven", "wait"), step(2, "oven")])
    carried_out(made, [step(number) for number in range(3, 60)])
    assert "step(2)" not in cell.taken
    carried_out(made, [DriverCommand(60, CommandKind.CONTINUE, "oven", "continue", about=1)])
    assert "step(2)" in cell.taken
