"""Writing and reading a run's journal: records are on disk first, spoiled ones are bad input."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, Protocol

from cellwright.engine.model.run_protocol import JournalRecord, RecordKind
from cellwright.engine.pipelines.execution.record_shapes import DamagedRecord, read_record
from cellwright.engine.pipelines.planning.plan_gate import InternalError
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.store.journal import JournalLine

Watcher = Callable[[JournalRecord], None]


class RecordLedger(Protocol):
    """Where records go. `append` returns when they are on the disk."""

    def append(self, records: Sequence[JournalRecord]) -> None:
        """Append records. Raises `JournalFailure` if that fails; then none of them is there."""
        ...


class Recorder:
    """Notes records in groups.

    When a run is taken up again inside a case, it first meets the records that are there already.
    """

    def __init__(
        self,
        ledger: RecordLedger,
        clock: Callable[[], int],
        watchers: Sequence[Watcher] = (),
        last: int = 0,
    ) -> None:
        self.ledger, self.clock, self.watchers, self.last = ledger, clock, tuple(watchers), last
        self.waiting: list[JournalRecord] = []
        self.known: list[JournalRecord] = []

    def note(self, kind: RecordKind, **content: Any) -> JournalRecord:
        """Note a record, to be written with the next group."""
        if self.known:
            if self.known[0].kind is kind:
                return self.known.pop(0)
            self.known.clear()
        self.last += 1
        record = JournalRecord(self.last, self.clock(), kind, content)
        self.waiting.append(record)
        return record

    def told(self, kind: RecordKind) -> JournalRecord | None:
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
                self._show(record, watcher)

    def _show(self, record: JournalRecord, watcher: Watcher) -> None:
        """Show a record to one who watches.

        Whose terminal or file is gone sees no more; the run goes on without.
        """
        try:
            watcher(record)
        except OSError:
            self.watchers = tuple(other for other in self.watchers if other is not watcher)

    def forget_unwritten(self) -> None:
        """Leave out what was noted and is not written."""
        self.last -= len(self.waiting)
        self.waiting.clear()
        self.known.clear()


@contextmanager
def reading_past(store: str, run: str) -> Iterator[None]:
    """A context that reads the records of a run.

    Raises `InvalidInput` where they say what no run writes.
    """
    try:
        yield
    except DamagedRecord as error:
        reason = f"the journal of run '{run}' says what no run writes: {error}"
        hint = "`cellwright store restore BACKUP --replace` puts a backup in its place"
        raise InvalidInput([Diagnostic(Source(store), "K422", reason[:200], hint)]) from error


@contextmanager
def trusting_past(store: str, run: str, is_proved: bool) -> Iterator[None]:
    """A context that goes on from the records of a run. Of records that are not proved to be as
    they were written, what follows from them is no mistake of ours.

    Raises `InvalidInput` if plans that follow from them are refused by the checker.
    """
    try:
        yield
    except InternalError as error:
        if is_proved:
            raise
        said = str(error).splitlines()[-1]
        with reading_past(store, run):
            raise DamagedRecord(f"it does not fit together: {said}") from error


def read_records(store: str, run: str, lines: Iterable[JournalLine]) -> Iterator[JournalRecord]:
    """The records of a run, each looked at. Raises `InvalidInput` if no run writes one of them."""
    with reading_past(store, run):
        for line in lines:
            yield read_record(line)
