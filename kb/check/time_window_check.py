"""Whether steps do what windows of time are about."""

from collections.abc import Collection, Iterator

from cellwright.kb.diagnostics import Diagnostic
from cellwright.kb.model.domain_model import Domain
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.model.time_windows import EventKind, EventPattern, TimeWindow

NOTHING_DOES = {
    EventKind.EVENT: "no operator has it as an event",
    EventKind.FACT: "nothing makes it true",
    EventKind.ENDING: "nothing makes it true, so it never ends",
}


def idle_windows(
    domain: Domain, problems: Collection[Problem], added: Collection[str]
) -> Iterator[Diagnostic]:
    """Warnings about windows that name what no plan does; `added` are the predicates that steps,
    rules and initial facts make true.
    """
    windows = [*domain.windows, *(window for problem in problems for window in problem.windows)]
    for window in windows:
        for pattern in (window.earlier, window.later):
            if pattern.kind in NOTHING_DOES and pattern.atom.name not in added:
                yield _idle(window, pattern)


def _idle(window: TimeWindow, pattern: EventPattern) -> Diagnostic:
    message = f"this window is about {pattern.atom}, but {NOTHING_DOES[pattern.kind]}"
    hint = "name an event, a fluent or a step that plans have, or take the window out"
    return Diagnostic(window.where, "K321", message, hint, warning=True)
