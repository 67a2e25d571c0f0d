"""How long steps have lasted in runs, from their journals, and the ranges that follow from it."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from math import ceil, floor
from statistics import fmean, pstdev

from cellwright.engine.model.run_protocol import CommandKind, RecordKind
from cellwright.engine.pipelines.execution.run_journal import reading_past
from cellwright.kb.asp import ground_term
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.model.domain_model import SPREADS_EACH_WAY, Operator, VaryingDuration
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.store.journal import Begun, Journal, JournalLine
from cellwright.kb.terms import Function, Number, Operation, Term

MIN_STEPS = 20  # steps of an operator, from which on a range is learned
MAX_RUNS = 500  # the newest runs of a domain that are read
SHARES = 1000  # shares of the forecast are counted in so many parts
Rounding = Callable[[Fraction], int]
TIMED_KINDS = (RecordKind.COMMAND.value, RecordKind.DONE.value)


@dataclass(frozen=True, slots=True)
class LearnedDuration:
    """How long the steps of an operator have lasted, as shares of their forecasts."""

    operator: str
    steps: int
    least: float
    most: float
    mean: float
    deviation: float

    @property
    def text(self) -> str:
        """The same in words."""
        low, high = round(100 * self.least), round(100 * self.most)
        return f"{self.operator} took {low} to {high} % of its forecast in {self.steps} steps"


def learn_durations(store: str, problem: Problem) -> tuple[LearnedDuration, ...]:
    """What the journals of a store say of the operators of a problem's domain that they know
    enough steps of. Raises `InvalidInput` if there are none.
    """
    shares: dict[str, list[float]] = {}
    with Journal(store) as journal:
        runs = [begun for begun in journal.begun() if _is_of(begun, problem)]
        for begun in runs[-MAX_RUNS:]:
            with reading_past(store, begun.run):
                for operator, share in _shares(journal.lines(begun.run, kinds=TIMED_KINDS)):
                    shares.setdefault(operator, []).append(share)
    learned = tuple(
        LearnedDuration(name, len(own), min(own), max(own), fmean(own), pstdev(own))
        for name, own in sorted(shares.items())
        if len(own) >= MIN_STEPS
    )
    if not learned:
        message = f"no operator of {problem.domain.name} was carried out often enough there"
        hint = f"a range is learned from {MIN_STEPS} steps of an operator"
        raise InvalidInput([Diagnostic(Source(store), "K421", message, hint)])
    return learned


def _is_of(begun: Begun, problem: Problem) -> bool:
    return str(begun.document.get("domain", "")) == problem.domain.name


def _shares(lines: Iterable[JournalLine]) -> Iterator[tuple[str, float]]:
    """The operator of each step that was done, and the share of its forecast that it has taken."""
    forecasts: dict[int, int] = {}
    for line in lines:
        content = line.content
        if line.kind == RecordKind.COMMAND.value:
            if content["command_kind"] == CommandKind.STEP.value:
                forecasts[content["command"]] = content["lasts_ms"]
            continue
        forecast = forecasts.pop(content.get("command", 0), 0)
        step = ground_term(content["action"])
        if forecast > 0 and isinstance(step, Function):
            yield step.name, (line.at_ms - content["started_ms"]) / forecast


def with_learned_durations(problem: Problem, learned: Iterable[LearnedDuration]) -> Problem:
    """The problem with ranges that are learned in place of those of its domain."""
    by_name: Mapping[str, LearnedDuration] = {each.operator: each for each in learned}
    operators = tuple(
        _with_range(operator, by_name[operator.name]) if operator.name in by_name else operator
        for operator in problem.domain.operators
    )
    return replace(problem, domain=replace(problem.domain, operators=operators))


def _with_range(operator: Operator, learned: LearnedDuration) -> Operator:
    """An operator that lasts its mean duration, and varies as far as was seen or as three times
    its deviation reaches, whichever is farther. What takes no time stays so.
    """
    if operator.duration is None:
        return operator
    reach = SPREADS_EACH_WAY * learned.deviation
    least = max(0.0, min(learned.least, learned.mean - reach))
    most = max(learned.most, learned.mean + reach)
    duration = operator.duration
    return replace(
        operator,
        duration=_share_of(duration, learned.mean, rounding=round),
        varies=VaryingDuration(
            _share_of(duration, least, rounding=floor),
            _share_of(duration, most, rounding=ceil),
            _share_of(duration, learned.deviation, rounding=ceil),
        ),
    )


def _share_of(duration: Term, share: float, rounding: Rounding) -> Term:
    """A share of a duration, as a term."""
    whole = rounding(Fraction(share) * SHARES)
    if isinstance(duration, Number):
        return Number(rounding(Fraction(duration.value * whole, SHARES)))
    return Operation("/", Operation("*", duration, Number(whole)), Number(SHARES))
