"""What a run does with its driver when it is over, whatever ended it: rest, and a last halt.

`cellwright.engine.pipelines.execution.coming_to_rest` has the usual way. Here is what holds for the
unusual ones: an error, and a process that is stuck.
"""

import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass

from cellwright.engine.ports import Driver

REST_MS = 5_000  # motions may take so long to come to their end when a run is told to end
TOLD_TO_END = "told to end"
_open_drivers: list[Driver] = []
_listing = threading.Lock()


@dataclass
class CellRest:
    """Whether the driver of a run has been brought to rest for good."""

    is_told: bool = False

    def break_off(self, driver: Driver) -> None:
        """Have the cell come to rest after an error, whatever the driver makes of it."""
        if self.is_told:
            return
        self.is_told = True
        with suppress(Exception):
            driver.quiesce(0)
        with suppress(Exception):
            driver.halt()


@contextmanager
def leaving_safely(driver: Driver) -> Iterator[CellRest]:
    """A context in which a driver is used. It is brought to rest if an error ends the context, and
    is closed in any case.
    """
    rest = CellRest()
    with _listing:
        _open_drivers.append(driver)
    try:
        yield rest
    except BaseException:
        rest.break_off(driver)
        raise
    finally:
        with _listing:
            _open_drivers.remove(driver)
        driver.close()


def halt_open_drivers() -> bool:
    """Halt what this process drives, from another thread than the one that drives: that one is
    stuck. Whether there was a driver.
    """
    with _listing:
        drivers = list(_open_drivers)
    for driver in drivers:
        with suppress(Exception):
            getattr(driver, "stop_from_outside", driver.halt)()
    return bool(drivers)
