"""The motions of a run's steps. They are looked for in a process of their own, so that pages stay quick."""

import asyncio
import multiprocessing
import time
from collections.abc import Sequence
from concurrent.futures import BrokenExecutor, ProcessPoolExecutor
from functools import lru_cache

from cellwright.engine.faces.monitor.following import Follower
from cellwright.engine.pipelines.execution.retracing import Retracing, Taken
from cellwright.engine.pipelines.units.parents import end_with_parent
from cellwright.kb.diagnostics import InvalidInput

BATCH_S = 1.0  # how long is searched before the page gets what was found
KNOWN = 4  # runs whose motions a process goes on with
Target = tuple[str, str, str]  # target, goals, command, as a run was begun with


class Motions:
    """The motions of the steps that one run has begun, in their order; `why_none` tells why there are none."""

    def __init__(self, store: str, run: str, target: Target) -> None:
        self.taken: list[Taken] = []
        self.why_none = ""
        self._asked = (store, run, target)
        self._looked = 0
        self._busy = False

    @property
    def looked(self) -> int:
        """The number of the last record whose motion was looked for."""
        return self._looked

    async def refresh(self, number: int, workers: ProcessPoolExecutor) -> None:
        """Look for the motions up to a record, unless that goes on already."""
        if self._busy or self.why_none:
            return
        self._busy = True
        try:
            while self._looked < number and not self.why_none:
                asked = (*self._asked, self._looked, number)
                answer = await asyncio.wrap_future(workers.submit(further, *asked))
                self._looked, found, self.why_none = answer
                self.taken += found
        except BrokenExecutor as gone:
            self.why_none = f"the process that looks for motions has ended: {gone}"
        finally:
            self._busy = False

    def at(self, number: int) -> Sequence[Taken]:
        """The motions that had begun up to a record."""
        count = len(self.taken)
        while count and self.taken[count - 1].number > number:
            count -= 1
        return self.taken[:count]


def workers() -> ProcessPoolExecutor:
    """One process that looks for motions. It ends with the monitor, however that ends."""
    return ProcessPoolExecutor(1, multiprocessing.get_context("spawn"), end_with_parent)


def further(store: str, run: str, target: Target, since: int, until: int) -> tuple[int, list[Taken], str]:
    """The number of the record that was looked at last, the motions of steps behind record `since`, and why there can be none."""
    try:
        follower, retracing, seen = _retraced(store, run, target)
    except InvalidInput as refused:
        return until, [], refused.diagnostics[0].message
    follower.refresh()
    start, ready = time.monotonic(), [each for each in seen if since < each.number <= until]
    last = max(since, retracing.number)
    for record in follower.records[last:until]:
        if (found := retracing.take(record)) is not None:
            seen.append(found)
            ready.append(found)
        last = record.number
        if time.monotonic() - start > BATCH_S:
            break
    return max(last, min(until, retracing.number)), ready, ""


@lru_cache(KNOWN)
def _retraced(store: str, run: str, target: Target) -> tuple[Follower, Retracing, list[Taken]]:
    from cellwright.engine.pipelines.planning import problem_of
    from cellwright.engine.plugins import geometry_backend
    from cellwright.kb.loader.cell import cell_of

    problem, cell = problem_of(*target), cell_of(target[0])
    return Follower(store, run), Retracing.of(problem, cell, geometry_backend()), []
