"""Executors of units: this process alone, processes of this machine, or a cluster."""

from collections.abc import Generator, Sequence
from dataclasses import dataclass
from typing import TypeVar

from cellwright.engine.kernels.cancellation import Interrupted
from cellwright.engine.pipelines.jobs.unit_scheduler import UNIT_INTERRUPTED, UnitScheduler
from cellwright.engine.pipelines.jobs.work_units import WorkCrew, WorkKind, WorkUnit, carry_out_unit

J = TypeVar("J")
R = TypeVar("R")


def crew_of(processes: int, cluster: str = "", modules: Sequence[str] = ()) -> WorkCrew:
    """The workers of a cluster if there is the address of one, else so many processes of this
    machine.

    These begin at once to load `modules`, which units need. Raises `InvalidInput` if nobody answers
    at the address.
    """
    if cluster:
        from cellwright.engine.pipelines.jobs.dask_cluster import require_open

        require_open(cluster)
        return ClusterCrew(cluster)
    if processes == 1:
        return AloneCrew()
    if modules:
        from cellwright.engine.pipelines.jobs.process_pool import begin_loading

        begin_loading(modules)
    return ProcessCrew(processes)


@dataclass(frozen=True, slots=True)
class AloneCrew:
    """This process."""

    def carry_out(
        self, kind: WorkKind[J, R], units: Sequence[WorkUnit[J]], interrupted: Interrupted
    ) -> Generator[tuple[WorkUnit[J], R], None, None]:
        """See `Crew`."""
        for unit in units:
            yield (
                unit,
                kind.lost(unit.job, UNIT_INTERRUPTED)
                if interrupted()
                else carry_out_unit(kind, unit, interrupted),
            )


@dataclass(frozen=True, slots=True)
class ProcessCrew:
    """So many processes of this machine. They end when they are told to, and with their parent."""

    count: int

    def carry_out(
        self, kind: WorkKind[J, R], units: Sequence[WorkUnit[J]], interrupted: Interrupted
    ) -> Generator[tuple[WorkUnit[J], R], None, None]:
        """See `Crew`."""
        from cellwright.engine.pipelines.jobs.process_pool import open_pool

        with open_pool(min(self.count, len(units))) as hands:
            yield from UnitScheduler(kind, units, hands).results(interrupted)


@dataclass(frozen=True, slots=True)
class ClusterCrew:
    """The workers of a Dask cluster whose scheduler has this address.

    They see the same files and reach the same store.
    """

    address: str

    def carry_out(
        self, kind: WorkKind[J, R], units: Sequence[WorkUnit[J]], interrupted: Interrupted
    ) -> Generator[tuple[WorkUnit[J], R], None, None]:
        """See `Crew`. Raises `InvalidInput` if there is no cluster that can be used."""
        from cellwright.engine.pipelines.jobs.dask_cluster import connect_workers

        with connect_workers(self.address) as hands:
            yield from UnitScheduler(kind, units, hands).results(interrupted)
