"""Work through a set of problems offline, in parallel processes, so that a store holds the answers in advance.

Every problem is planned, and MACROPs are learned from the plans. If the domain chooses tools for measurements, their
sequence is kept, too.
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
from engine.model.measurements import chooses_tools
from engine.model.outcome import Found, GaveUp
from engine.pipelines.inspection.keeping import carry_on
from engine.pipelines.planning import loaded
from engine.pipelines.reuse.practice import Practice
from engine.stages.macros.lifted.digests import Digests
from engine.stages.planning import Limits
from kb import stopping
from kb.diagnostics import Diagnostic, InvalidInput
from kb.model.domain import Domain
from kb.model.problem import Problem
from kb.stopping import Stopped
from kb.store import Library
from kb.targets import CELL_FILE

ENDING = 0.5  # seconds that processes may take to end their searches
SPAWN = multiprocessing.get_context("spawn")


@dataclass(frozen=True, slots=True)
class KeptSequence:
    """The sequence that is kept for a problem. `left` is the number of visits that are not done.

    `way` is `made`, `kept` (as it was) or `resequenced`. `changes` counts the visits that were reordered, moved to another
    tool, added, dropped or outdated since the last time.
    """

    way: str
    left: int
    changes: Mapping[str, int]


@dataclass(frozen=True, slots=True)
class KeptPoses:
    """What is kept of where the arm can stand for measurements: counts, and the measurements out of reach, with the reasons."""

    reached: int
    made: int
    kept: int
    unreached: Mapping[str, str]


@dataclass(frozen=True, slots=True)
class Prepared:
    """The result for one problem. `status`: found, infeasible, gave up or bad input.

    `origin`, `macrop`, `name` and `reason` are those of `Answered`.
    """

    problem: str
    status: str
    origin: str = ""
    macrop: int | None = None
    name: str = ""
    reason: str = ""
    seconds: float = 0.0
    diagnostics: tuple[Diagnostic, ...] = ()
    sequence: KeptSequence | None = None
    poses: KeptPoses | None = None


@dataclass(frozen=True, slots=True)
class Preparation:
    """The results for a set of problems.

    `stale` holds the MACROPs that were removed: for each number the parts of the domain that had changed.
    """

    problems: tuple[Prepared, ...]
    stale: Mapping[int, tuple[str, ...]] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class PreparationJob:
    """What one process needs to plan a problem: the problem's file, the store, and the limits of the search."""

    path: Path
    store: str
    expansions: int
    seed: int


def silent(_done: int, _of: int) -> None:
    """Show no progress."""


def prepare(
    paths: Sequence[Path],
    store: str,
    limits: Limits,
    processes: int,
    progress: Callable[[int, int], None] = silent,
) -> Preparation:
    """Plan every problem file, and keep what was learned. Stale MACROPs of the domains are removed first.

    When `limits.interrupted` holds, running searches end and the remaining problems are not planned. Raises `InvalidInput`
    if the library cannot be used.
    """
    try:
        stale = _without_stale(paths, store)
    except Stopped:
        return Preparation(tuple(_interrupted(path) for path in paths))
    jobs = [PreparationJob(path, store, limits.expansions, limits.seed) for path in paths]
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
    """The domains of all problems that can be read, each once. Errors in the other files are reported later."""
    found: dict[str, Domain] = {}
    for path in paths:
        with contextlib.suppress(InvalidInput):
            domain = loaded(path).domain
            found.setdefault(domain.path or domain.name, domain)
    return list(found.values())


def _run(
    jobs: Sequence[PreparationJob], processes: int, interrupted: Interrupted
) -> Generator[tuple[PreparationJob, Prepared], None, None]:
    """The jobs with their results, in the order in which they are finished.

    Processes are spawned, so that none inherits a connection or the lock of a thread.
    """
    if processes == 1:
        for job in jobs:
            yield job, work(job, interrupted)
        return
    stop = SPAWN.Event()
    with _pool(min(processes, len(jobs) or 1), stop) as pool:
        with _deaf():
            waiting: dict[Future[Prepared], PreparationJob] = {pool.submit(work, job): job for job in jobs}
        while waiting and not interrupted():
            done, _ = wait(waiting, timeout=0.2, return_when=FIRST_COMPLETED)
            for each in done:
                yield waiting.pop(each), each.result()
        stop.set()
        wait(waiting, timeout=ENDING)
        late = [each for each in waiting if not each.done()]
        if late:
            _kill()
        for each, job in waiting.items():
            yield job, _interrupted(job.path) if each in late else each.result()


@contextlib.contextmanager
def _pool(processes: int, stop: Event) -> Iterator[ProcessPoolExecutor]:
    """A pool of processes. Their searches end when `stop` is set. A second Ctrl-C kills them."""
    pool = ProcessPoolExecutor(processes, SPAWN, _listen, (stop,))
    try:
        yield pool
        pool.shutdown(wait=True, cancel_futures=True)
    except BaseException:
        _kill()
        raise


def _kill() -> None:
    for process in multiprocessing.active_children():
        process.kill()


@contextlib.contextmanager
def _deaf() -> Iterator[None]:
    """Processes that are started inside this context ignore Ctrl-C, which a terminal sends to them, too.

    The parent process handles Ctrl-C and tells them to stop.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


_STOPS: list[Event] = []  # in a process of the pool: the event that tells it to stop


def _listen(stop: Event) -> None:
    """In a process of the pool: stop its searches and its grounding when `stop` is set."""
    _STOPS.append(stop)
    stopping.asking(_stopped).__enter__()


def _stopped() -> bool:
    return any(each.is_set() for each in _STOPS)


def work(job: PreparationJob, interrupted: Interrupted = _stopped) -> Prepared:
    """Plan one problem with the library in the store, and bring its kept sequence up to date."""
    if interrupted():
        return _interrupted(job.path)
    try:
        problem = loaded(job.path).problem
        if problem is None:
            return Prepared(str(job.path), "bad input", reason="this is a domain, not a problem")
        measures = chooses_tools(problem.domain)
        poses = _poses(job.store, problem) if measures else None
        kept = _kept(job.store, problem) if measures else None
        limits = Limits(job.expansions, seed=job.seed, interrupted=interrupted)
        with Library(job.store) as library, Practice(library, limits) as practice:
            answered = practice.plan(problem)
    except InvalidInput as error:
        return Prepared(str(job.path), "bad input", diagnostics=tuple(error.diagnostics))
    except Stopped:
        return _interrupted(job.path)
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
        poses=poses,
    )


def _interrupted(path: Path) -> Prepared:
    return Prepared(path.stem, "gave up", reason="interrupted")


def _poses(store: str, problem: Problem) -> KeptPoses | None:
    """Bring the poses of a problem's measurements up to date in the store; None without a cell that says what arms do."""
    path = Path(problem.domain.path).with_name(CELL_FILE)
    if not problem.domain.path or not path.is_file():
        return None
    from engine.pipelines.poses.keeping import kept_poses  # geometry is slow to load
    from engine.plugins import geometry_backend
    from kb.loader.cell import load_cell

    cell = load_cell(path)
    if not cell.operations:
        return None
    found = kept_poses(store, problem, cell, geometry_backend())
    reached = {each.measurement for each in found.poses.values() if each.reached}
    return KeptPoses(len(reached), found.made, found.kept, found.unreached())


def _kept(store: str, problem: Problem) -> KeptSequence:
    """Bring the kept sequence of a problem's measurements up to date in the store, and report on it."""
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
