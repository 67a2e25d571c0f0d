"""What a unit of work is, how one is carried out, and how results are noted in a ledger."""

from collections.abc import Callable, Generator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Generic, Protocol, TypeVar

from cellwright.engine.kernels.cancellation import Interrupted
from cellwright.kb import stopping

if TYPE_CHECKING:
    from cellwright.kb.store.draft import Draft

J = TypeVar("J")
R = TypeVar("R")


def silent(_done: int, _of: int) -> None:
    """Show no progress."""


@dataclass(frozen=True, slots=True)
class Unit(Generic[J]):
    """A piece of work. `name` says which among its kind, `key` is a digest of all that its result depends on."""

    name: str
    key: str
    job: J


@dataclass(frozen=True, slots=True)
class Ledger:
    """Where the results of finished units of a kind are noted: in a store, as JSON.

    `finished` says whether a unit with this result need not be done again. `written` gives what is noted of a result, None
    for nothing; `read` is its inverse.
    """

    store: str
    finished: Callable[[Any], bool]
    written: Callable[[Any], Mapping[str, Any] | None]
    read: Callable[[Mapping[str, Any]], Any]


@dataclass(frozen=True, slots=True)
class Drafted(Generic[R]):
    """A result, and the changes of the store that go with it. They are written when the result is noted, in the same transaction.

    `settled` is the result with the numbers that the changes got, or without them if they were not written.
    """

    draft: "Draft"
    settled: Callable[[], R]


@dataclass(frozen=True, slots=True)
class Kind(Generic[J, R]):
    """A kind of work. Its functions are those of a module, so that they can be named to another process.

    `work` carries out one job; what it changes in the store of the ledger it leaves in a draft. `lost` is the result of a job that could not be carried out, with the reason.
    """

    name: str
    work: Callable[[J, Interrupted], R | Drafted[R]]
    lost: Callable[[J, str], R]
    ledger: Ledger | None = None


class Crew(Protocol):
    """Who carries units out: this process, processes of this machine, or a cluster."""

    def carry_out(
        self, kind: Kind[J, R], units: Sequence[Unit[J]], interrupted: Interrupted
    ) -> Generator[tuple[Unit[J], R], None, None]:
        """The units with their results, in the order in which they are finished.

        Ends soon after `interrupted` holds; then every unit that is not finished has the result `lost`.
        """
        ...


def carried_out(
    kind: Kind[J, R], units: Sequence[Unit[J]], crew: Crew, interrupted: Interrupted
) -> Generator[tuple[Unit[J], R], None, None]:
    """All units with their results; first those that the ledger holds, then the others as they are finished.

    When the last one is finished, the ledger forgets them. Raises `InvalidInput` if the ledger cannot be used.
    """
    noted = _noted(kind, units)
    left = [each for each in units if each.name not in noted]
    for each in units:
        if each.name in noted:
            yield each, noted[each.name]
    whole = True
    for unit, result in crew.carry_out(kind, left, interrupted) if left else ():
        whole = whole and kind.ledger is not None and kind.ledger.finished(result)
        yield unit, result
    if kind.ledger is not None and whole:
        _forget(kind, kind.ledger, units)


def one(kind: Kind[J, R], unit: Unit[J], interrupted: Interrupted) -> R:
    """Carry out one unit, unless somebody has done so in the meantime, and note its result.

    The note and all that the unit changes in the store are written together: whenever this process is killed, both are there
    or neither.
    """
    noted = _noted(kind, [unit])
    if noted:
        return noted[unit.name]
    with stopping.asking(interrupted):
        made = kind.work(unit.job, interrupted)
    result = made.settled() if isinstance(made, Drafted) else made
    ledger = kind.ledger
    if ledger is None or not ledger.finished(result) or (content := ledger.written(result)) is None:
        return result
    from cellwright.kb.store.units import UnitStore

    with UnitStore(ledger.store, kind.name) as store:
        if not isinstance(made, Drafted):
            store.keep(unit.name, unit.key, content)
        elif store.settle(unit.name, unit.key, made.draft, lambda: ledger.written(made.settled()) or content):
            return made.settled()
    return _noted(kind, [unit]).get(unit.name, result)


def _noted(kind: Kind[J, R], units: Sequence[Unit[J]]) -> dict[str, R]:
    if kind.ledger is None or not units:
        return {}
    from cellwright.kb.store.units import UnitStore

    with UnitStore(kind.ledger.store, kind.name) as store:
        found = store.finished({each.name: each.key for each in units})
    return {name: kind.ledger.read(content) for name, content in found.items()}


def _forget(kind: Kind[J, R], ledger: Ledger, units: Sequence[Unit[J]]) -> None:
    from cellwright.kb.store.units import UnitStore

    with UnitStore(ledger.store, kind.name) as store:
        store.clear([each.name for each in units])
