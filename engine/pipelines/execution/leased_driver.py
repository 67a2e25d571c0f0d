"""Driver that sends only while the lease of the run is held.

Of two hosts that drive one run, the one without the lease sends nothing, not even `halt`: the other
one moves the cell. A controller that keeps fencing numbers refuses an older one by itself, so it
may be told to halt also when the database does not say who holds the lease.
"""

from collections.abc import Mapping, Sequence

from cellwright.engine.model.run_protocol import DriverCommand, Message, Report
from cellwright.engine.ports import Driver, Simulated
from cellwright.kb.store.journal import JournalFailure
from cellwright.kb.store.run_lease import RunLease


class LeasedDriver:
    """A driver of a run whose lease is looked at before anything is sent.

    Its methods raise `LeaseLost` if another process has the lease, `JournalFailure` if nobody can
    tell.
    """

    def __init__(self, driver: Driver, lease: RunLease) -> None:
        self._driver, self._lease = driver, lease

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
        self._lease.require()
        self._driver.send(commands)

    def receive(self, until_ms: int | None) -> Sequence[Message]:
        """What has come since the last call."""
        self._lease.require()
        return self._driver.receive(until_ms)

    def quiesce(self, within_ms: int) -> Sequence[Message]:
        """Begin nothing more, and bring what is under way to its end."""
        self._lease.require()
        return self._driver.quiesce(within_ms)

    def halt(self) -> None:
        """Stop every motion at once, if this process may say so."""
        try:
            self._lease.require()
        except JournalFailure:
            if self._lease.is_lost or not getattr(self._driver, "fenced", False):
                return
        self._driver.halt()

    def report(self, numbers: Sequence[int]) -> Sequence[Report]:
        """What became of commands."""
        self._lease.require()
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
        self._lease.require()
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
