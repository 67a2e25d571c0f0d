"""Sequences that are kept in a store between calls. Several processes may use the store at the same time."""

from collections.abc import Collection

from engine.model.measurements import is_shared
from engine.pipelines.inspection.progress import News, Progress, carried_on, resources
from engine.pipelines.points import with_places
from engine.stages.sequencing import Limits
from kb.diagnostics import Diagnostic, InvalidInput, Source
from kb.model.problem import Problem
from kb.store.sequences import SequencePlan, Sequences


def carry_on(
    store: str, problem: Problem, news: News = News(), limits: Limits = Limits(), anew: bool = False
) -> Progress:
    """Bring the kept sequence of a problem up to date, or make one; `anew` forgets the kept one.

    Raises `InvalidInput`, for a problem too whose measurements several arms share.

    If another process has written the sequence in the meantime, the news is applied to what it wrote, so that nothing is
    lost.
    """
    problem = with_places(problem)
    if is_shared(problem):
        said, hint = "several arms share the measurements, and a kept sequence is of one", "leave --store out"
        raise InvalidInput([Diagnostic(Source(problem.path), "K404", said, hint)])
    with Sequences(store) as sequences:
        while True:
            kept = sequences.of(problem.domain.name, problem.name)
            plan = SequencePlan(problem.domain.name, problem.name, version=kept.version if kept else 0)
            progress = carried_on(plan if kept is None or anew else kept, problem, news, limits)
            if progress.plan == kept or sequences.keep(progress.plan):
                return progress


def told_of_losses(store: str, problem: Problem, lost: Collection[str]) -> Progress | None:
    """The kept sequence of a problem after tools or resources were lost; None if none is kept. Raises `InvalidInput`.

    Names in `lost` that are neither objects nor resources of the problem do not concern the sequence, and are ignored.
    """
    with Sequences(store) as sequences:
        if sequences.of(problem.domain.name, problem.name) is None:
            return None
    return carry_on(store, problem, News(lost=tuple(name for name in lost if name in resources(problem))))
