"""One problem of a preparation: it is planned, and what was learned is kept in the store."""

from dataclasses import replace

from cellwright.engine.kernels.cancellation import Interrupted
from cellwright.engine.model.measurements import chooses_tools
from cellwright.engine.model.outcome import Found, GaveUp
from cellwright.engine.pipelines.objective import sequenced
from cellwright.engine.pipelines.planning import LARGE, loaded
from cellwright.engine.pipelines.preparation.poses import cell_of_measurements
from cellwright.engine.pipelines.preparation.results import KeptPoses, KeptSequence, PreparationJob, Prepared
from cellwright.engine.pipelines.reuse.practice import Answered, Practice
from cellwright.engine.pipelines.units import Drafted
from cellwright.engine.pipelines.units.content import require_same
from cellwright.engine.pipelines.units.course import INTERRUPTED
from cellwright.engine.stages.grounding.limits import size
from cellwright.engine.stages.planning import Limits
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.model.problem import Problem
from cellwright.kb.stopping import Stopped
from cellwright.kb.store.draft import Draft

UNUSABLE = "K416"  # of a library: another time it may be there


def work(job: PreparationJob, interrupted: Interrupted) -> Prepared | Drafted[Prepared]:
    """Plan one problem with the library in the store, and bring its kept sequence up to date.

    What is learned waits in a draft. Poses and the sequence are written at once: they replace older ones, so finding them twice does no
    harm.
    """
    if interrupted():
        return lost(job, INTERRUPTED)
    try:
        require_same(job.path, job.content)
        problem = loaded(job.path).problem
        if problem is None:
            return Prepared(str(job.path), "bad input", reason="this is a domain, not a problem")
        measures = chooses_tools(problem.domain)
        poses = _poses(job.store, problem) if measures else None
        kept = _kept(job.store, problem) if measures else None
        limits = Limits(job.expansions, seed=job.seed, interrupted=interrupted)
        draft, answered = _answered(job.store, problem, limits)
    except InvalidInput as error:
        finished = all(each.code != UNUSABLE for each in error.diagnostics)
        return Prepared(str(job.path), "bad input", diagnostics=tuple(error.diagnostics), finished=finished)
    except Stopped:
        return lost(job, INTERRUPTED)
    outcome = answered.outcome
    prepared = Prepared(
        problem.name,
        "found" if isinstance(outcome, Found) else "gave up" if isinstance(outcome, GaveUp) else "infeasible",
        answered.origin,
        answered.macrop,
        answered.name,
        answered.reason if isinstance(outcome, Found) else outcome.reason,
        sum(outcome.statistics.seconds.values()),
        sequence=kept,
        poses=poses,
        finished=not interrupted(),
    )
    return Drafted(draft, lambda: replace(prepared, macrop=draft.settled(prepared.macrop)))


def _answered(store: str, problem: Problem, limits: Limits) -> tuple[Draft, Answered]:
    """The answer for a problem, which the library keeps. Of measurements that are too many to be planned at once, as `plan` does:
    they follow their sequence. What was learned is in the draft.
    """
    with Draft(store) as library, Practice(library, limits) as practice:
        if size(problem) > LARGE:
            memory = practice.repertoire(problem.domain) if practice.learns else None
            followed = sequenced(problem, limits, memory, store)
            if followed is not None:
                return library, Answered(followed.outcome, "sequence")
        answered = practice.plan(problem)
    return library, answered


def lost(job: PreparationJob, why: str) -> Prepared:
    """The result for a problem whose planning did not end."""
    return Prepared(job.path.stem, "gave up", reason=why, finished=False)


def _poses(store: str, problem: Problem) -> KeptPoses | None:
    """Bring the poses of a problem's measurements up to date in the store; None without a cell that says what arms do."""
    cell = cell_of_measurements(problem)
    if cell is None:
        return None
    from cellwright.engine.pipelines.poses.keeping import kept_poses  # geometry is slow to load
    from cellwright.engine.plugins import geometry_backend

    found = kept_poses(store, problem, cell, geometry_backend())
    reached = {each.measurement for each in found.poses.values() if each.reached}
    return KeptPoses(len(reached), found.made, found.kept, found.unreached())


def _kept(store: str, problem: Problem) -> KeptSequence:
    """Bring the kept sequence of a problem's measurements up to date in the store, and report on it."""
    from cellwright.engine.pipelines.parts.keeping import (
        carry_on,  # slow to load, and only inspections need it
    )

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
