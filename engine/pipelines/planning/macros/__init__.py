"""Plans with a library of MACROPs: problems are looked up first, and new plans are learned."""

from cellwright.engine.pipelines.planning.macros.library_planner import (
    LibraryAnswer,
    LibraryPlanner,
)

__all__ = ["LibraryAnswer", "LibraryPlanner"]
