"""Driver `external`: a controller in another process that speaks JSON lines (docs/drivers.md)."""

from cellwright.engine.pipelines.execution.controllers.remote_driver import (
    ControllerDriver,
    external_controller,
)

__all__ = ["ControllerDriver", "external_controller"]
