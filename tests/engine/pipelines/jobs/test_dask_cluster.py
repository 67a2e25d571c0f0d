"""The workers of a Dask cluster carry units out as processes of this machine do."""

import os
import signal
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from cellwright.engine.kernels.cancellation import never
from cellwright.engine.pipelines.jobs import WorkKind, carried_out, crew_of
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.garbage_collection import COLLECTION_THRESHOLD
from tests.engine.pipelines.jobs.test_work_units import (
    kind,
    lost,
    marks,
    results,
    tell_threshold,
    units,
)

pytestmark = pytest.mark.slow
pytest.importorskip("distributed", reason="the extra 'cluster' is not installed")


@pytest.fixture(scope="module")
def cluster() -> Iterator[Any]:
    from benchmarks.clusters import Cluster

    with Cluster.started(Path(__file__).parents[4], 2) as started:
        yield started


def test_a_cluster_does_what_processes_do(cluster: Any, tmp_path: Path) -> None:
    asked = units(tmp_path, "a", "b", "c")
    address = cluster.address
    assert results(kind(), asked, crew_of(0, address)) == results(kind(), asked, crew_of(1))


def test_workers_look_for_cycles_as_rarely_as_the_command_does(
    cluster: Any, tmp_path: Path
) -> None:
    telling = WorkKind("test", tell_threshold, lost)
    found = results(telling, units(tmp_path, "a"), crew_of(0, cluster.address))
    assert found["a"].split()[0] == str(COLLECTION_THRESHOLD)


def test_a_worker_that_dies_is_replaced_and_its_unit_done(cluster: Any, tmp_path: Path) -> None:
    address = cluster.address
    found = results(
        kind(tmp_path / "s.db"), units(tmp_path, "a", "die once", "eat"), crew_of(0, address)
    )
    assert found == {
        "a": "done a",
        "die once": "done die once",
        "eat": "unfinished eat: out of memory",
    }


def test_workers_hear_that_a_unit_is_not_wanted_any_more(cluster: Any, tmp_path: Path) -> None:
    address, until = cluster.address, time.monotonic() + 60

    def interrupted() -> bool:
        return marks(tmp_path, "wait") > 0 or time.monotonic() > until

    crew = crew_of(0, address)
    found = dict(carried_out(kind(), units(tmp_path, "wait"), crew, interrupted))
    assert list(found.values()) == ["unfinished wait: interrupted"]
    assert results(kind(), units(tmp_path, "a"), crew) == {"a": "done a"}


def test_a_scheduler_that_ends_is_told_and_what_is_finished_is_kept(tmp_path: Path) -> None:
    from benchmarks.clusters import Cluster

    asked = units(tmp_path, "a", "wait")
    with Cluster.started(Path(__file__).parents[4], 1) as own:
        found = {}
        for unit, said in carried_out(
            kind(tmp_path / "s.db"), asked, crew_of(0, own.address), never
        ):
            found[unit.name] = said
            if unit.name == "a":
                os.kill(own.processes["scheduler"].pid, signal.SIGKILL)
    assert found["a"] == "done a"
    assert "is gone; start again" in found["wait"]
    with pytest.raises(InvalidInput, match="refused"):
        crew_of(0, own.address)
