"""The results of a run, from its journal: what was measured, and what was done to each object."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from cellwright.engine.model.execution import RecordKind
from cellwright.engine.model.measurements import chooses_tools
from cellwright.engine.model.verdicts import Survey
from cellwright.engine.pipelines.inspection import partition
from cellwright.engine.pipelines.measuring import Measuring
from cellwright.engine.pipelines.past import reading_past
from cellwright.engine.pipelines.planning import problem_of
from cellwright.engine.pipelines.verdicts.spoiling import spoilt_in
from cellwright.kb.asp import ground_term
from cellwright.kb.model.problem import Problem
from cellwright.kb.model.results import Measured, Results, Treated
from cellwright.kb.store.journal import Begun, Journal, Line
from cellwright.kb.terms import Function, Term

KINDS = (RecordKind.REPLY.value, RecordKind.DONE.value)
KNOWN = (
    RecordKind.PLAN,
    RecordKind.ALIGNMENT,
    RecordKind.GIVEN_UP,
    RecordKind.WORLD,
    RecordKind.DECISION,
)
TOLD = tuple(each.value for each in KNOWN)


def runs_in(store: str) -> tuple[Begun, ...]:
    """The runs that have a journal in a store, the oldest first. Raises `InvalidInput`."""
    with Journal(store) as journal:
        return journal.begun()


def results_of(store: str, run: str) -> Results:
    """What a run has given until now. Raises `InvalidInput` if there is no such run, or its target is no longer there."""
    with Journal(store) as journal:
        begun = journal.known(run)
        about = begun.document
        problem = problem_of(*(str(about.get(each, "")) for each in ("target", "goals", "command")))
        with reading_past(store, run):
            return read(begun, problem, journal.lines(run, kinds=KINDS))


@dataclass(frozen=True)
class Told:
    """The results of a run, and what they show of the part; no survey for a run without measurements.

    `subjects` are the objects that the workflow is about.
    """

    results: Results
    survey: Survey | None
    subjects: tuple[str, ...] = ()


def survey_of(store: str, run: str) -> Told:
    """What a run has given until now, and what that shows. Raises `InvalidInput` as `results_of` does."""
    from cellwright.engine.pipelines.verdicts.surveying import survey  # it needs numpy

    with Journal(store) as journal:
        begun = journal.known(run)
        about = begun.document
        problem = problem_of(*(str(about.get(each, "")) for each in ("target", "goals", "command")))
        with reading_past(store, run):
            results = read(begun, problem, journal.lines(run, kinds=KINDS))
            subjects = tuple(dict.fromkeys(str(chain.subject) for chain in problem.chains))
            if not results.measured:
                return Told(results, None, subjects)
            told = list(journal.lines(run, kinds=TOLD))
    placed = [(line.content, line.at_ms) for line in told if line.kind == RecordKind.ALIGNMENT.value]
    given_up = list(_given_up(told))
    spoilt = spoilt_in((line.content, line.at_ms) for line in told if line.kind == RecordKind.WORLD.value)
    again = _again(line.content for line in told if line.kind == RecordKind.DECISION.value)
    surveyed = survey(problem, results, placed, given_up, _impossible(problem), spoilt, again)
    return Told(results, surveyed, subjects)


def _given_up(told: Iterable[Line]) -> Iterator[tuple[str, str]]:
    """The goals that were given up, each with its reason: before a plan was made, or while it was carried out."""
    for line in told:
        if line.kind == RecordKind.PLAN.value:
            yield from ((goal, why) for goal, why in line.content.get("given_up", ()))
        elif line.kind == RecordKind.GIVEN_UP.value:
            yield line.content["goal"], line.content["why"]


def _again(decisions: Iterable[Mapping[str, Any]]) -> dict[str, list[str]]:
    """Why measurements were made again, by name, as decisions of a run say."""
    found: dict[str, list[str]] = {}
    for content in decisions:
        for name, each in content.get("again", {}).items():
            found.setdefault(name, []).append(each["why"])
    return found


def _impossible(problem: Problem) -> Mapping[str, str]:
    return partition(problem).impossible if chooses_tools(problem.domain) else {}


def read(begun: Begun, problem: Problem, lines: Iterable[Line]) -> Results:
    """The results in the lines of a journal."""
    reader = _Reader(problem)
    for line in lines:
        reader.take(line)
    return Results(begun.run, begun.begun, tuple(reader.measured), tuple(reader.history))


@dataclass
class _Reader:
    """Reads a journal line by line. A value counts when its step is done: other replies are exceptions."""

    problem: Problem
    measured: list[Measured] = field(default_factory=list)
    history: list[Treated] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.replies: dict[int, str] = {}
        domain = self.problem.domain
        named = {**domain.objects, **self.problem.objects}
        closed = {name for name, each in domain.types.items() if each.constants}  # settings, not things
        self.objects = {name for name, type_ in named.items() if type_ not in closed}
        self.measuring = Measuring(self.problem)

    def take(self, line: Line) -> None:
        content = line.content
        if line.kind == RecordKind.REPLY.value:
            self.replies[content["command"]] = content["text"]
            return
        step = ground_term(content["action"])
        if not isinstance(step, Function):
            return
        reply = self.replies.pop(content.get("command", 0), "")
        self._measure(step, reply, line.at_ms)
        changes = [*content.get("adds", ()), *content.get("events", ())]
        for each in dict.fromkeys(name for name in _names(step) if name in self.objects):
            own = tuple(change for change in changes if each in set(_names(ground_term(change))))
            self.history.append(Treated(each, str(step), content["started_ms"], line.at_ms, own))

    def _measure(self, step: Function, reply: str, at_ms: int) -> None:
        found = self.measuring.heard(step, reply, at_ms) if reply else None
        if found is not None:
            self.measured.append(found)


def _names(term: Term) -> Iterator[str]:
    """The names in the arguments of a term, those of compound terms as a whole and in their parts."""
    for argument in term.arguments if isinstance(term, Function) else ():
        yield str(argument)
        yield from _names(argument)
