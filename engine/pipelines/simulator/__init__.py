"""The built-in driver `sim`: a cell on a virtual clock, in which an hour takes milliseconds, and faults happen as ordered."""

from cellwright.engine.pipelines.simulator.driver import Simulator, fault_base, simulator
from cellwright.engine.pipelines.simulator.hidden import HiddenCell
from cellwright.engine.pipelines.simulator.injections import Injection
from cellwright.engine.pipelines.simulator.settings import Settings, number_of, settings_of
from cellwright.engine.pipelines.simulator.showing import possible

__all__ = [
    "HiddenCell",
    "Injection",
    "Settings",
    "Simulator",
    "fault_base",
    "number_of",
    "possible",
    "settings_of",
    "simulator",
]
