"""Why no plan keeps a window: the shortest time from one event to the other, and what needs it."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations, islice

from cellwright.engine.model.ground_task import GroundOperator, GroundTask
from cellwright.engine.model.noun_wording import count_noun
from cellwright.engine.model.window_breaches import WindowBreach
from cellwright.engine.stages.grounding import ground
from cellwright.engine.stages.scheduling.least_lags import (
    NEVER,
    AfterStep,
    LeastLag,
    alike_in_length,
)
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.model.domain_model import Operator
from cellwright.kb.model.plan_model import INITIAL_STEP
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.model.time_windows import EventKind, EventPattern, Side, TimeWindow
from cellwright.kb.terms import Atom, Function, Term, Variable, substitute_atom, term_variables

MAX_PROVED_WINDOWS = 6  # broken windows of which a proof is tried
MAX_CHECKED_OBJECTS = 2  # objects for which `check` looks at a window
MAX_TOLD_STEPS = 6


@dataclass(frozen=True, slots=True)
class ShortestLag:
    """The shortest possible time between the two events of a window, over all plans.

    `steps` are what has to be done meanwhile, with how long it takes. With `is_needed` every plan
    has both events in this order.
    """

    breach: WindowBreach
    lasts: int
    steps: tuple[tuple[Function, int], ...]
    is_needed: bool

    def text(self, unit: str) -> str:
        """The window, and why it cannot be kept."""
        window, breach = self.breach.window, self.breach
        said = f"{window.limits} {unit} from {breach.earlier} to {breach.later}"
        told = [f"{step} {lasts} {unit}" for step, lasts in self.steps[:MAX_TOLD_STEPS]]
        more = len(self.steps) - MAX_TOLD_STEPS
        told += [count_noun(more, "more step")] if more > 0 else []
        because = f", because it takes {', then '.join(told)}" if told else ""
        return f"{said}; the shortest possible is {self.lasts} {unit}{because}"


def find_impossible_window(
    problem: Problem, breaches: Sequence[WindowBreach], floor: int = 0
) -> ShortestLag | None:
    """A window among those that a plan breaks which no plan can keep; None if none is found. No
    plan ends before `floor`.

    One that every plan has comes first.
    """
    late = [each for each in breaches if each.is_late][:MAX_PROVED_WINDOWS]
    try:
        task = ground(problem) if late else None
    except InvalidInput:
        return None
    if task is None or not task.whole:
        return None
    proved = [lag for each in late if (lag := _shortest(problem, task, each)) is not None]
    proved += [
        ShortestLag(each, floor, (), True)
        for each in late
        if each.events == (None, None) and floor > (each.window.most or floor)
    ]
    return min(proved, key=lambda lag: (not lag.is_needed, -lag.lasts), default=None)


def find_windows_too_short(problem: Problem, task: GroundTask) -> Iterator[ShortestLag]:
    """The windows without a price that no plan of a workflow can keep, each for one object."""
    for window in problem.all_windows if task.whole else ():
        if window.is_hard and window.most is not None:
            spans = islice(_stage_spans(problem, window), MAX_CHECKED_OBJECTS)
            lags = (_shortest(problem, task, span) for span in spans)
            yield from islice((lag for lag in lags if lag is not None and lag.is_needed), 1)


def _stage_spans(problem: Problem, window: TimeWindow) -> Iterator[WindowBreach]:
    """The windows between stages of chains, in words; how long they last is left open."""
    for chain in problem.chains:
        stages: list[Atom | None] = [*chain.stages]
        for one, other in combinations([None, *stages], 2):
            ends = ((one, window.earlier), (other, window.later))
            if all(_fits(window, event, pattern) for event, pattern in ends):
                said = [
                    f"the {pattern.side} of {'the plan' if event is None else event}"
                    for event, pattern in ends
                ]
                yield WindowBreach(
                    window, said[0], said[1], 0, 0, (INITIAL_STEP, INITIAL_STEP), (one, other)
                )


def _fits(window: TimeWindow, event: Atom | None, pattern: EventPattern) -> bool:
    if event is None or pattern.kind is EventKind.PLAN:
        return event is None and pattern.kind is EventKind.PLAN
    return pattern.kind is EventKind.EVENT and window.bindings(pattern, event) is not None


def _shortest(problem: Problem, task: GroundTask, breach: WindowBreach) -> ShortestLag | None:
    window, most = breach.window, breach.window.most
    patterns = _about(breach)
    needed = _is_needed(problem, *patterns)
    spans = list(_spans(problem, task, *patterns))
    if most is None or not spans:
        return None
    lasts, lag, ends = min(spans, key=lambda span: span[0])
    if lasts <= most or lasts >= NEVER:
        return None
    own = [ends[0]] if ends[0] is not None and window.earlier.side is Side.START else []
    own += lag.steps
    own += [ends[1]] if ends[1] is not None and window.later.side is Side.END else []
    steps = tuple((step.instance, step.duration) for step in own if step.duration)
    return ShortestLag(breach, lasts, steps, needed)


Span = tuple[int, LeastLag, tuple[GroundOperator | None, GroundOperator | None]]


def _spans(
    problem: Problem, task: GroundTask, earlier: EventPattern, later: EventPattern
) -> Iterator[Span]:
    """The least time between the events for each pair of steps that may be meant."""
    groups = alike_in_length(_steps_of(problem, task, earlier))
    if earlier.kind is EventKind.PLAN:
        groups = [()]
    last = () if later.kind is EventKind.PLAN else tuple(_steps_of(problem, task, later))
    for group in groups:
        after, first = AfterStep(task, group), group[0] if group else None
        begun = first.duration if first is not None and earlier.side is Side.START else 0
        if later.kind is EventKind.PLAN:
            lag = min((after.least(goals) for goals in task.goals), key=lambda each: each.lasts)
            yield lag.lasts + begun, lag, (first, None)
        for step in last:
            lag = after.least(step.preconditions, step)
            ended = step.duration if later.side is Side.END else 0
            yield lag.lasts + begun + ended, lag, (first, step)


def _about(breach: WindowBreach) -> tuple[EventPattern, EventPattern]:
    """The patterns of a window about the objects of a breach: what both have in common is bound."""
    window = breach.window
    patterns = window.earlier, window.later
    values: dict[Variable, Term] = {}
    for pattern, event in zip(patterns, breach.events, strict=True):
        if event is not None:
            values |= window.bindings(pattern, event) or {}
    own = [set(term_variables(p.atom)) for p in patterns if p.kind is not EventKind.PLAN]
    in_both = set.intersection(*own) if own else set()
    bound = {variable: value for variable, value in values.items() if variable in in_both}
    one, other = (
        EventPattern(pattern.kind, substitute_atom(pattern.atom, bound), pattern.side)
        for pattern in patterns
    )
    return one, other


def _steps_of(
    problem: Problem, task: GroundTask, pattern: EventPattern
) -> Iterator[GroundOperator]:
    """All steps that may be what a pattern means."""
    schemas = {operator.name: operator for operator in problem.domain.operators}
    for step in task.operators:
        operator = schemas.get(step.instance.name)
        if operator is None:
            continue
        match pattern.kind:
            case EventKind.STEP:
                may = _may_be(pattern.atom, step.instance)
            case EventKind.EVENT:
                may = any(_may_be(pattern.atom, event) for event in _events(operator, step))
            case EventKind.FACT:
                new = task.names(step.adds & ~step.preconditions)
                may = any(_may_be(pattern.atom, atom) for atom in new)
            case _:
                may = any(_may_be(pattern.atom, atom) for atom in task.names(step.deletes))
        if may:
            yield step


def _events(operator: Operator, step: GroundOperator) -> Iterator[Atom]:
    """What an operator adds, with the values of its header."""
    values = dict(zip(operator.variables, step.instance.arguments, strict=True))
    return (substitute_atom(e.atom, values) for e in operator.effects if e.adds)


def _may_be(one: Term, other: Term) -> bool:
    """Whether two terms may be the same for some values of their variables."""
    if isinstance(one, Variable) or isinstance(other, Variable):
        return True
    if isinstance(one, Function) and isinstance(other, Function):
        return (
            one.name == other.name
            and len(one.arguments) == len(other.arguments)
            and all(map(_may_be, one.arguments, other.arguments))
        )
    return one == other


def _is_needed(problem: Problem, earlier: EventPattern, later: EventPattern) -> bool:
    """Whether every plan has the later event after the earlier one: they are stages of a chain."""
    if later.kind is EventKind.PLAN:
        return earlier.kind is EventKind.PLAN or _is_stage(problem, earlier)
    if earlier.kind is EventKind.PLAN:
        return _is_stage(problem, later)
    for chain in problem.chains:
        places = [n for n, stage in enumerate(chain.stages) if _is_certainly(earlier, stage)]
        last = [n for n, stage in enumerate(chain.stages) if _is_certainly(later, stage)]
        if chain.wanted and places and last and places[0] < last[-1]:
            return True
    return False


def _is_stage(problem: Problem, pattern: EventPattern) -> bool:
    stages = (stage for chain in problem.chains if chain.wanted for stage in chain.stages)
    return any(_is_certainly(pattern, stage) for stage in stages)


def _is_certainly(pattern: EventPattern, stage: Atom) -> bool:
    """Whether a stage is an event that a pattern means, whatever its variables are."""
    return pattern.kind is EventKind.EVENT and _may_be(pattern.atom, stage)
