"""A problem set worked through offline, in parallel processes, so that a store knows it before it is needed.

Every problem is planned, which teaches MACROPs; where the domain chooses tools for measurements, their sequence is kept.
"""

import contextlib
import multiprocessing
import signal
import threading
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from dataclasses import dataclass, field
from multiprocessing.synchronize import Event
from pathlib import Path

from engine.kernels.cancellation import Interrupted
from engine.model.outcome import Found, GaveUp
from engine.pipelines.inspection import chooses_tools
from engine.pipelines.inspection.keeping import carry_on
from engine.pipelines.reuse.practice import Practice
from engine.stages.macros.lifted.digests import Digests
from engine.stages.planning import Limits
from kb.diagnostics import Diagnostic, InvalidInput
from kb.loader import load
from kb.model.domain import Domain
from kb.model.problem import Problem
from kb.store import Library

SPAWN = multiprocessing.get_context("spawn")


@dataclass(frozen=True, slots=True)
class KeptSequence:
    """The sequence that was kept for a problem. `way`: made, kept as it was, or resequenced; `left`: visits not done.

    `changes` counts the visits that are reordered, moved to another tool, added, dropped or outdated since it was kept before.
    """

    way: str
    left: int
    changes: Mapping[str, int]


@dataclass(frozen=True, slots=True)
class Prepared:
    """What became of one problem. `status`: found, infeasible, gave up or bad input; the rest as `Answered` has it."""

    problem: str
    status: str
    origin: str = ""
    macrop: int | None = None
    name: str = ""
    reason: str = ""
    seconds: float = 0.0
    diagnostics: tuple[Diagnostic, ...] = ()
    sequence: KeptSequence | None = None


@dataclass(frozen=True, slots=True)
class Preparation:
    """A problem set that was worked through. `stale` MACROPs were removed; they name the parts that had changed."""

    problems: tuple[Prepared, ...]
    stale: Mapping[int, tuple[str, ...]] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Job:
    """What one process is told."""

    path: Path
    store: str
    expansions: int
    seed: int


def silent(_done: int, _of: int) -> None:
    """No progress is shown."""


def prepare(
    paths: Sequence[Path],
    store: str,
    limits: Limits,
    processes: int,
    progress: Callable[[int, int], None] = silent,
) -> Preparation:
    """Plan every problem file and keep what was learned; `limits.interrupted` ends the searches and what is left.

    A domain's stale MACROPs are removed first. Raises `InvalidInput` where the library refuses.
    """
    stale = _without_stale(paths, store)
    jobs = [Job(path, store, limits.expansions, limits.seed) for path in paths]
    found: dict[Path, Prepared] = {}
    with contextlib.closing(_run(jobs, processes, limits.interrupted)) as answers:
        for job, prepared in answers:
            found[job.path] = prepared
            progress(len(found), len(jobs))
    return Preparation(tuple(found[path] for path in paths if path in found), stale)


def _without_stale(paths: Sequence[Path], store: str) -> dict[int, tuple[str, ...]]:
    gone: dict[int, tuple[str, ...]] = {}
    with Library(store) as library:
        for domain in _domains(paths):
            outdated = library.outdated(domain.name, Digests(domain).of)
            library.forget(outdated)
            gone |= outdated
    return gone


def _domains(paths: Sequence[Path]) -> list[Domain]:
    """The domains of the problems that can be read, each once; what is wrong with the others is said later."""
    found: dict[str, Domain] = {}
    for path in paths:
        with contextlib.suppress(InvalidInput):
            domain = load(path).domain
            found.setdefault(domain.path or domain.name, domain)
    return list(found.values())


def _run(
    jobs: Sequence[Job], processes: int, interrupted: Interrupted
) -> Generator[tuple[Job, Prepared], None, None]:
    """Answers as they come. Processes are spawned, so that none inherits a connection or a thread's lock."""
    if processes == 1:
        for job in jobs:
            yield job, work(job, interrupted)
        return
    stop = SPAWN.Event()
    with _pool(min(processes, len(jobs) or 1), stop) as pool:
        with _deaf():
            waiting: dict[Future[Prepared], Job] = {pool.submit(work, job): job for job in jobs}
        while waiting and not interrupted():
            done, _ = wait(waiting, timeout=0.2, return_when=FIRST_COMPLETED)
            for each in done:
                yield waiting.pop(each), each.result()
        stop.set()
        for each, job in waiting.items():
            yield job, each.result()


@contextlib.contextmanager
def _pool(processes: int, stop: Event) -> Iterator[ProcessPoolExecutor]:
    """Processes whose searches end when `stop` is set; at the second Ctrl-C they are killed."""
    pool = ProcessPoolExecutor(processes, SPAWN, _listen, (stop,))
    try:
        yield pool
        pool.shutdown(wait=True, cancel_futures=True)
    except BaseException:
        for process in multiprocessing.active_children():
            process.kill()
        raise


@contextlib.contextmanager
def _deaf() -> Iterator[None]:
    """Processes started here do not hear Ctrl-C, which a terminal sends to them, too; who started them sees to it."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


_STOPS: list[Event] = []  # in a process of the pool: what is set when it is to end


def _listen(stop: Event) -> None:
    _STOPS.append(stop)


def _stopped() -> bool:
    return any(each.is_set() for each in _STOPS)


def work(job: Job, interrupted: Interrupted = _stopped) -> Prepared:
    """Sequence and plan one problem through the store."""
    if interrupted():
        return Prepared(job.path.stem, "gave up", reason="interrupted")
    try:
        problem = load(job.path).problem
        if problem is None:
            return Prepared(str(job.path), "bad input", reason="this is no problem")
        kept = _kept(job.store, problem) if chooses_tools(problem.domain) else None
        limits = Limits(job.expansions, seed=job.seed, interrupted=interrupted)
        with Library(job.store) as library, Practice(library, limits) as practice:
            answered = practice.plan(problem)
    except InvalidInput as error:
        return Prepared(str(job.path), "bad input", diagnostics=tuple(error.diagnostics))
    outcome = answered.outcome
    return Prepared(
        problem.name,
        "found" if isinstance(outcome, Found) else "gave up" if isinstance(outcome, GaveUp) else "infeasible",
        answered.origin,
        answered.macrop,
        answered.name,
        answered.reason if isinstance(outcome, Found) else outcome.reason,
        sum(outcome.statistics.seconds.values()),
        sequence=kept,
    )


def _kept(store: str, problem: Problem) -> KeptSequence:
    """The sequence of a problem's measurements, brought up to date in the store."""
    found = carry_on(store, problem)
    counts = {
        "reordered": len(found.reordered),
        "moved": len(found.moved),
        "added": len(found.added),
        "dropped": len(found.dropped),
        "outdated": len(found.outdated),
    }
    changes = {what: count for what, count in counts.items() if count} if found.way != "made" else {}
    return KeptSequence(found.way, len(found.plan.rest), changes)
