"""The driver `external`: a controller in a process of its own, which speaks JSON, one object a line (docs/drivers.md)."""

from cellwright.engine.pipelines.controllers.driver import ControllerDriver, external

__all__ = ["ControllerDriver", "external"]
