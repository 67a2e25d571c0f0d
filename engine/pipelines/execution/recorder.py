"""Writes a run's journal: what is noted is on the disk before anything that follows from it is done."""

from collections.abc import Callable, Sequence
from typing import Any, Protocol

from cellwright.engine.model.execution import Record, RecordKind

Watcher = Callable[[Record], None]


class Ledger(Protocol):
    """Where records go. `append` returns when they are on the disk."""

    def append(self, records: Sequence[Record]) -> None:
        """Append records. Raises `JournalFailure` if that fails; then none of them is there."""
        ...


class Recorder:
    """Notes records in groups. When a run is taken up again inside a case, it first meets the records that are there already."""

    def __init__(
        self, ledger: Ledger, clock: Callable[[], int], watchers: Sequence[Watcher] = (), last: int = 0
    ) -> None:
        self.ledger, self.clock, self.watchers, self.last = ledger, clock, tuple(watchers), last
        self.waiting: list[Record] = []
        self.known: list[Record] = []

    def note(self, kind: RecordKind, **content: Any) -> Record:
        """Note a record, to be written with the next group."""
        if self.known:
            if self.known[0].kind is kind:
                return self.known.pop(0)
            self.known.clear()
        self.last += 1
        record = Record(self.last, self.clock(), kind, content)
        self.waiting.append(record)
        return record

    def told(self, kind: RecordKind) -> Record | None:
        """The next record that is there already, if it is of this kind."""
        return self.known[0] if self.known and self.known[0].kind is kind else None

    def commit(self) -> None:
        """Write what was noted, and show it to those who watch. Raises `JournalFailure`."""
        if not self.waiting:
            return
        group, self.waiting = self.waiting, []
        try:
            self.ledger.append(group)
        except BaseException:
            self.waiting = group
            raise
        for record in group:
            for watcher in self.watchers:
                watcher(record)
