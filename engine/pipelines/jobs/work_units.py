"""Units of work: what one is, how it is carried out, and the ledger that keeps results."""

from collections.abc import Callable, Generator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Generic, Protocol, TypeVar

from cellwright.engine.kernels.cancellation import Interrupted
from cellwright.kb import stopping
from cellwright.kb import store as kb_store

if TYPE_CHECKING:
    from cellwright.kb.store.macrop_library import LibraryDraft

J = TypeVar("J")
R = TypeVar("R")


def show_nothing(_done: int, _of: int) -> None:
    """Show no progress."""


@dataclass(frozen=True, slots=True)
class WorkUnit(Generic[J]):
    """A piece of work. `name` says which among its kind, `key` is a digest of all that its
    result depends on.
    """

    name: str
    key: str
    job: J


@dataclass(frozen=True, slots=True)
class ResultLedger:
    """Where the results of finished units of a kind are noted: in a store, as JSON.

    `finished` says whether a unit with this result need not be done again. `written` gives what is
    noted of a result, None for nothing; `read` is its inverse.
    """

    store: str
    finished: Callable[[Any], bool]
    written: Callable[[Any], Mapping[str, Any] | None]
    read: Callable[[Mapping[str, Any]], Any]


@dataclass(frozen=True, slots=True)
class DraftedResult(Generic[R]):
    """A result, and the changes of the store that go with it. They are written when the result is
    noted, in the same transaction.

    `settled` is the result with the numbers that the changes got, or without them if they were not
    written.
    """

    draft: "LibraryDraft"
    settled: Callable[[], R]


@dataclass(frozen=True, slots=True)
class WorkKind(Generic[J, R]):
    """A kind of work. Its functions are those of a module, so that they can be named to another
    process.

    `work` carries out one job; what it changes in the store of the ledger it leaves in a draft.
    `lost` is the result of a job that could not be carried out, with the reason.
    """

    name: str
    work: Callable[[J, Interrupted], R | DraftedResult[R]]
    lost: Callable[[J, str], R]
    ledger: ResultLedger | None = None


class WorkCrew(Protocol):
    """Who carries units out: this process, processes of this machine, or a cluster."""

    def carry_out(
        self, kind: WorkKind[J, R], units: Sequence[WorkUnit[J]], interrupted: Interrupted
    ) -> Generator[tuple[WorkUnit[J], R], None, None]:
        """The units with their results, in the order in which they are finished.

        Ends soon after `interrupted` holds; then every unit that is not finished has the result
        `lost`.
        """
        ...


def carried_out(
    kind: WorkKind[J, R], units: Sequence[WorkUnit[J]], crew: WorkCrew, interrupted: Interrupted
) -> Generator[tuple[WorkUnit[J], R], None, None]:
    """All units with their results; first those that the ledger holds, then the others as they are
    finished.

    When the last one is finished, the ledger forgets them. Raises `InvalidInput` if the ledger
    cannot be used.
    """
    noted = _noted_results(kind, units)
    open_units = [unit for unit in units if unit.name not in noted]
    for open_unit in units:
        if open_unit.name in noted:
            yield open_unit, noted[open_unit.name]
    whole = True
    for unit, result in crew.carry_out(kind, open_units, interrupted) if open_units else ():
        whole = whole and kind.ledger is not None and kind.ledger.finished(result)
        yield unit, result
    if kind.ledger is not None and whole:
        _forget_units(kind, kind.ledger, units)


def carry_out_unit(kind: WorkKind[J, R], unit: WorkUnit[J], interrupted: Interrupted) -> R:
    """Carry out one unit, unless somebody has done so in the meantime, and note its result.

    The note and all that the unit changes in the store are written together: whenever this process
    is killed, both are there or neither.
    """
    noted = _noted_results(kind, [unit])
    if noted:
        return noted[unit.name]
    with stopping.asking_to_stop(interrupted):
        made_result = kind.work(unit.job, interrupted)
    result = made_result.settled() if isinstance(made_result, DraftedResult) else made_result
    ledger = kind.ledger
    if ledger is None or not ledger.finished(result) or (content := ledger.written(result)) is None:
        return result
    with kb_store.UnitStore(ledger.store, kind.name) as store:
        if not isinstance(made_result, DraftedResult):
            store.keep(unit.name, unit.key, content)
        elif store.settle(
            unit.name,
            unit.key,
            made_result.draft,
            lambda: ledger.written(made_result.settled()) or content,
        ):
            return made_result.settled()
    return _noted_results(kind, [unit]).get(unit.name, result)


def _noted_results(kind: WorkKind[J, R], units: Sequence[WorkUnit[J]]) -> dict[str, R]:
    if kind.ledger is None or not units:
        return {}
    with kb_store.UnitStore(kind.ledger.store, kind.name) as store:
        finished = store.finished({unit.name: unit.key for unit in units})
    return {name: kind.ledger.read(content) for name, content in finished.items()}


def _forget_units(kind: WorkKind[J, R], ledger: ResultLedger, units: Sequence[WorkUnit[J]]) -> None:
    with kb_store.UnitStore(ledger.store, kind.name) as store:
        store.clear([unit.name for unit in units])
