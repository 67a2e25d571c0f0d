"""Whether steps do what windows and calendars are about, and windows contradict each other."""

from collections.abc import Collection, Iterator
from itertools import permutations, repeat

from cellwright.kb.diagnostics import Diagnostic
from cellwright.kb.model.domain_model import Domain
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.model.time_windows import EventKind, EventPattern, TimeWindow
from cellwright.kb.terms import Function, Term, Variable, unify

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


def contradictory_windows(domain: Domain, problems: Collection[Problem]) -> Iterator[Diagnostic]:
    """Warnings about two windows between the same events that no time keeps both of."""
    for windows in [domain.windows, *(problem.all_windows for problem in problems)]:
        hard = [window for window in windows if window.is_hard]
        for longer, shorter in permutations(hard, 2):
            least, most = longer.least, shorter.most
            if least is not None and most is not None and least > most and _same(longer, shorter):
                message = f"no time is at least {least} and at most {most}, as line "
                message += f"{shorter.where.line} of {shorter.where.path} says"
                yield Diagnostic(longer.where, "K321", message, "change one of both", warning=True)


def _same(one: TimeWindow, other: TimeWindow) -> bool:
    """Whether two windows are about the same events of some objects."""
    if any(a.kind is not b.kind or a.side is not b.side for a, b in _ends(one, other)):
        return False
    named: dict[Term, Term] = {}
    return all(_alike(a.atom, b.atom, named) for a, b in _ends(one, other))


def _ends(one: TimeWindow, other: TimeWindow) -> list[tuple[EventPattern, EventPattern]]:
    return [(one.earlier, other.earlier), (one.later, other.later)]


def _alike(one: Term, other: Term, named: dict[Term, Term]) -> bool:
    """Whether two terms are the same but for the names of variables."""
    if isinstance(one, Variable) and isinstance(other, Variable):
        return named.setdefault(one, other) == other
    if isinstance(one, Function) and isinstance(other, Function):
        same = one.name == other.name and len(one.arguments) == len(other.arguments)
        return same and all(map(_alike, one.arguments, other.arguments, repeat(named)))
    return one == other


def idle_calendars(domain: Domain, problems: Collection[Problem]) -> Iterator[Diagnostic]:
    """Warnings about calendars of what no step holds."""
    held = [term for operator in domain.operators for term in operator.resources]
    objects = {*domain.objects, *(name for problem in problems for name in problem.objects)}
    calendars = [*domain.calendars, *(own for problem in problems for own in problem.calendars)]
    for calendar in calendars:
        may_be = (_may_hold(term, calendar.of, objects) for term in held)
        if not calendar.is_step and not any(may_be):
            message = f"this calendar is about {calendar.of}, but no step holds that"
            hint = "name what steps have under `resources:`, or an operator"
            yield Diagnostic(calendar.where, "K322", message, hint, warning=True)


def _may_hold(term: Term, wanted: Function, objects: Collection[str]) -> bool:
    """Whether a resource of an operator may be what a calendar is about."""
    if isinstance(term, Variable) and not wanted.arguments:
        return wanted.name in objects
    return unify(wanted, term, {}) is not None


def _idle(window: TimeWindow, pattern: EventPattern) -> Diagnostic:
    message = f"this window is about {pattern.atom}, but {NOTHING_DOES[pattern.kind]}"
    hint = "name an event, a fluent or a step that plans have, or take the window out"
    return Diagnostic(window.where, "K321", message, hint, warning=True)
