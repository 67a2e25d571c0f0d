"""Simulators: drivers for cells that do not exist. `sim` has a virtual clock and ordered faults."""

from cellwright.engine.pipelines.simulators.simulator_settings import (
    Injection,
    SimulatorSettings,
    option_number,
    settings_of,
)
from cellwright.engine.pipelines.simulators.true_state import HiddenCell, exceptions_of_cause
from cellwright.engine.pipelines.simulators.virtual_clock import (
    Simulator,
    fault_base,
    simulated_driver,
)

__all__ = [
    "HiddenCell",
    "Injection",
    "Simulator",
    "SimulatorSettings",
    "exceptions_of_cause",
    "fault_base",
    "option_number",
    "settings_of",
    "simulated_driver",
]
