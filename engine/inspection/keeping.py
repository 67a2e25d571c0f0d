"""Sequences that are kept in a store between calls, whoever else uses it."""

from engine.inspection.progress import News, Progress, carried_on
from engine.sequencing import Limits
from kb.model.problem import Problem
from kb.store.sequences import SequencePlan, Sequences


def carry_on(
    store: str, problem: Problem, news: News = News(), limits: Limits = Limits(), anew: bool = False
) -> Progress:
    """Bring the kept sequence of a problem up to date, or make it; `anew` forgets what was kept. Raises `InvalidInput`.

    Where another process has written in the meantime the news are told to what it wrote: nothing is lost.
    """
    with Sequences(store) as sequences:
        while True:
            kept = sequences.of(problem.domain.name, problem.name)
            plan = SequencePlan(problem.domain.name, problem.name, version=kept.version if kept else 0)
            progress = carried_on(plan if kept is None or anew else kept, problem, news, limits)
            if progress.plan == kept or sequences.keep(progress.plan):
                return progress


def is_kept(store: str, problem: Problem) -> bool:
    """Whether a store keeps a sequence of a problem. Raises `InvalidInput`."""
    with Sequences(store) as sequences:
        return sequences.of(problem.domain.name, problem.name) is not None
