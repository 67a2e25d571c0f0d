"""Sequences that are kept in a store between calls. Several processes may use the store at the same time."""

from collections.abc import Collection

from cellwright.engine.model.measurements import is_shared
from cellwright.engine.pipelines.inspection.progress import News, Progress, carried_on, resources
from cellwright.engine.pipelines.points import with_places
from cellwright.engine.stages.sequencing import Limits
from cellwright.kb.model.problem import Problem
from cellwright.kb.store.sequences import SequencePlan, Sequences


def carry_on(
    store: str, problem: Problem, news: News = News(), limits: Limits = Limits(), anew: bool = False
) -> Progress:
    """Bring the kept sequence of a problem up to date, or make one; `anew` forgets the kept one. Raises `InvalidInput`.

    Where several arms share the measurements, the answer is a `SharedProgress`.

    If another process has written the sequence in the meantime, the news is applied to what it wrote, so that nothing is
    lost.
    """
    problem = with_places(problem)
    with Sequences(store) as sequences:
        while True:
            kept = sequences.of(problem.domain.name, problem.name)
            plan = SequencePlan(problem.domain.name, problem.name, version=kept.version if kept else 0)
            progress = _carried_on(plan if kept is None or anew else kept, problem, news, limits)
            if progress.plan == kept or sequences.keep(progress.plan):
                return progress


def _carried_on(plan: SequencePlan, problem: Problem, news: News, limits: Limits) -> Progress:
    if not is_shared(problem):
        return carried_on(plan, problem, news, limits)
    from cellwright.engine.pipelines.parts.kept_shares import (
        shares_carried_on,
    )  # slow to load, and one arm needs it never

    return shares_carried_on(plan, problem, news, limits)


def told_of_losses(store: str, problem: Problem, lost: Collection[str]) -> Progress | None:
    """The kept sequence of a problem after tools or resources were lost; None if none is kept. Raises `InvalidInput`.

    Names in `lost` that are neither objects nor resources of the problem do not concern the sequence, and are ignored.
    """
    with Sequences(store) as sequences:
        if sequences.of(problem.domain.name, problem.name) is None:
            return None
    return carry_on(store, problem, News(lost=tuple(name for name in lost if name in resources(problem))))
