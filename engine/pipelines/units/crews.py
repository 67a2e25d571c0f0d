"""Crews: this process alone, processes of this machine, or the workers of a cluster."""

from collections.abc import Generator, Sequence
from dataclasses import dataclass
from typing import TypeVar

from cellwright.engine.kernels.cancellation import Interrupted
from cellwright.engine.pipelines.units.course import INTERRUPTED, Course
from cellwright.engine.pipelines.units.work import Crew, Kind, Unit, one

J = TypeVar("J")
R = TypeVar("R")


def crew_of(processes: int, cluster: str = "", modules: Sequence[str] = ()) -> Crew:
    """The workers of a cluster if there is the address of one, else so many processes of this machine.

    These begin at once to load `modules`, which units need. Raises `InvalidInput` if nobody answers at the address.
    """
    if cluster:
        from cellwright.engine.pipelines.units.cluster import require_open

        require_open(cluster)
        return Cluster(cluster)
    if processes == 1:
        return Alone()
    if modules:
        from cellwright.engine.pipelines.units.pool import loading

        loading(modules)
    return Processes(processes)


@dataclass(frozen=True, slots=True)
class Alone:
    """This process."""

    def carry_out(
        self, kind: Kind[J, R], units: Sequence[Unit[J]], interrupted: Interrupted
    ) -> Generator[tuple[Unit[J], R], None, None]:
        """See `Crew`."""
        for unit in units:
            yield unit, kind.lost(unit.job, INTERRUPTED) if interrupted() else one(kind, unit, interrupted)


@dataclass(frozen=True, slots=True)
class Processes:
    """So many processes of this machine. They end when they are told to, and with their parent."""

    count: int

    def carry_out(
        self, kind: Kind[J, R], units: Sequence[Unit[J]], interrupted: Interrupted
    ) -> Generator[tuple[Unit[J], R], None, None]:
        """See `Crew`."""
        from cellwright.engine.pipelines.units.pool import pool

        with pool(min(self.count, len(units))) as hands:
            yield from Course(kind, units, hands).results(interrupted)


@dataclass(frozen=True, slots=True)
class Cluster:
    """The workers of a Dask cluster whose scheduler has this address. They see the same files and reach the same store."""

    address: str

    def carry_out(
        self, kind: Kind[J, R], units: Sequence[Unit[J]], interrupted: Interrupted
    ) -> Generator[tuple[Unit[J], R], None, None]:
        """See `Crew`. Raises `InvalidInput` if there is no cluster that can be used."""
        from cellwright.engine.pipelines.units.cluster import connected

        with connected(self.address) as hands:
            yield from Course(kind, units, hands).results(interrupted)
