"""MACROPs that are learned and used while one problem is planned; nothing is kept afterwards."""

from collections.abc import Hashable
from typing import Protocol

from cellwright.engine.stages.macros.lookup.index import Index
from cellwright.engine.stages.macros.lookup.lookup import Hit, look_up
from cellwright.engine.stages.macros.lookup.query import Query, readings
from cellwright.kb.model.macro import Macrop


class Memory(Protocol):
    """Where MACROPs are found and kept; a `Repertoire` of a library is one."""

    def find(self, asked: Query) -> Hit | None:
        """A checked plan for a query; None if no MACROP serves it."""
        ...

    def learn(self, macrop: Macrop, planning_s: float = 0.0) -> Hashable | None:
        """Keep a MACROP whose plan took so many seconds to find."""
        ...


class Notebook:
    """A memory of its own for one problem."""

    def __init__(self) -> None:
        self._index = Index()

    def find(self, asked: Query) -> Hit | None:
        """A checked plan for a query; None if no MACROP serves it."""
        return next(
            (hit for each in readings(asked) if (hit := look_up(self._index, each)) is not None), None
        )

    def learn(self, macrop: Macrop, planning_s: float = 0.0) -> Hashable | None:  # noqa: ARG002 - a notebook does not weigh
        """Keep a MACROP."""
        number = len(self._index) + 1
        self._index.add(number, macrop)
        return number
