"""Driver that sends only while the lease of the run is held.

Of two hosts that drive one run, the one without the lease sends nothing, not even `halt`: the other
one moves the cell. A controller that keeps fencing numbers refuses an older one by itself, so it
may be told to halt also when the database does not say who holds the lease.
"""

from collections.abc import Mapping, Sequence
from typing import Any

from cellwright.engine.model.run_protocol import (
    DriverCommand,
    Fate,
    Message,
    Report,
    Trouble,
    TroubleKind,
)
from cellwright.engine.ports import Driver, Simulated
from cellwright.kb.store.journal import JournalFailure
from cellwright.kb.store.run_lease import RunLease


class LeasedDriver:
    """A driver of a run whose lease is looked at before anything is sent.

    Without the lease nothing is sent, and the driver counts as lost: `receive` and `quiesce` say
    so.
    """

    def __init__(self, driver: Driver, lease: RunLease) -> None:
        self._driver, self._lease = driver, lease

    def __getattr__(self, name: str) -> Any:
        """What the driver has beside the port."""
        return getattr(self._driver, name)

    def _refusal(self) -> str:
        """Why nothing may be sent; empty if it may."""
        try:
            self._lease.require()
        except JournalFailure as error:
            return str(error)
        return ""

    def _may_halt(self) -> bool:
        """Whether the cell may be told to come to rest: nobody else drives it, or the controller
        refuses to obey then.
        """
        if not self._refusal():
            return True
        return not self._lease.is_lost and bool(getattr(self._driver, "fenced", False))

    def _loss(self, why: str) -> list[Message]:
        return [Trouble(TroubleKind.LOST, why, self.now_ms())]

    @property
    def tick_ms(self) -> int | None:
        """The control tick of the driver."""
        return self._driver.tick_ms

    def now_ms(self) -> int:
        """The clock of the driver."""
        return self._driver.now_ms()

    def lookahead(self, stream: str) -> int:
        """How many commands of a stream may be sent before the first has ended."""
        return self._driver.lookahead(stream)

    def send(self, commands: Sequence[DriverCommand]) -> None:
        """Hand over commands."""
        if not self._refusal():
            self._driver.send(commands)

    def receive(self, until_ms: int | None) -> Sequence[Message]:
        """What has come since the last call."""
        why = self._refusal()
        return self._loss(why) if why else self._driver.receive(until_ms)

    def quiesce(self, within_ms: int) -> Sequence[Message]:
        """Begin nothing more, and bring what is under way to its end."""
        if self._may_halt():
            return self._driver.quiesce(within_ms)
        return self._loss(self._refusal())

    def halt(self) -> None:
        """Stop every motion at once."""
        if self._may_halt():
            self._driver.halt()

    def stop_from_outside(self) -> None:
        """Stop every motion at once, from another thread than the one that drives."""
        if self._may_halt():
            getattr(self._driver, "stop_from_outside", self._driver.halt)()

    def report(self, numbers: Sequence[int]) -> Sequence[Report]:
        """What became of commands; nobody knows if nothing may be asked."""
        if self._refusal():
            return [Report(number, Fate.UNKNOWN) for number in numbers]
        return self._driver.report(numbers)

    def close(self) -> None:
        """Leave the cell as it is."""
        self._driver.close()


class LeasedSimulatedDriver(LeasedDriver):
    """The same for a simulated cell."""

    def __init__(self, driver: Driver, lease: RunLease) -> None:
        super().__init__(driver, lease)
        assert isinstance(driver, Simulated)
        self._simulated = driver

    def by_hand(self, adds: Sequence[str], ends: Sequence[str], reached: Mapping[str, int]) -> None:
        """A person has changed something in the cell."""
        if not self._refusal():
            self._simulated.by_hand(adds, ends, reached)

    def not_come(self) -> Sequence[str]:
        """The faults that were ordered and have not come up."""
        return self._simulated.not_come()


def under_lease(driver: Driver, lease: RunLease | None) -> Driver:
    """The driver under the lease of its run; as it is, if the run has none."""
    if lease is None:
        return driver
    kind = LeasedSimulatedDriver if isinstance(driver, Simulated) else LeasedDriver
    return kind(driver, lease)
