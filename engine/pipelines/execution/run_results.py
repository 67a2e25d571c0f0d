"""Results of a run from its journal: values measured, and what was done to each object."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from cellwright.engine.model.part_measurements import chooses_tools
from cellwright.engine.model.run_protocol import RecordKind
from cellwright.engine.model.verdicts import Survey
from cellwright.engine.pipelines import inspection
from cellwright.engine.pipelines.execution.run_journal import reading_past
from cellwright.engine.pipelines.inspection.nominal_values import MeasurementJudge
from cellwright.engine.pipelines.inspection.spoilt_values import spoilt_in
from cellwright.engine.pipelines.inspection.tool_tours import partition_by_tool
from cellwright.engine.pipelines.planning.target_files import problem_of
from cellwright.kb.asp import ground_term
from cellwright.kb.model.measured_results import Measured, Results, Treated
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.store.journal import Begun, Journal, JournalLine
from cellwright.kb.terms import Function, Term

RESULT_KINDS = (RecordKind.REPLY.value, RecordKind.DONE.value)
SURVEY_KINDS = (
    RecordKind.PLAN,
    RecordKind.ALIGNMENT,
    RecordKind.GIVEN_UP,
    RecordKind.WORLD,
    RecordKind.DECISION,
)
SURVEY_KIND_NAMES = tuple(kind.value for kind in SURVEY_KINDS)


def runs_in(store: str) -> tuple[Begun, ...]:
    """The runs that have a journal in a store, the oldest first. Raises `InvalidInput`."""
    with Journal(store) as journal:
        return journal.begun()


def results_of(store: str, run: str) -> Results:
    """What a run has given until now.

    Raises `InvalidInput` if there is no such run, or its target is no longer there.
    """
    with Journal(store) as journal:
        begun = journal.known(run)
        journal.require_whole(run, unchained=True)
        about = begun.document
        problem = problem_of(*(str(about.get(key, "")) for key in ("target", "goals", "command")))
        with reading_past(store, run):
            return read_run_results(begun, problem, journal.lines(run, kinds=RESULT_KINDS))


@dataclass(frozen=True)
class Told:
    """The results of a run, and what they show of the part; no survey for a run without
    measurements.

    `subjects` are the objects that the workflow is about.
    """

    results: Results
    survey: Survey | None
    subjects: tuple[str, ...] = ()


def survey_of(store: str, run: str) -> Told:
    """What a run has given until now, and what that shows.

    Raises `InvalidInput` as `results_of` does.
    """
    with Journal(store) as journal:
        begun = journal.known(run)
        journal.require_whole(run, unchained=True)
        about = begun.document
        problem = problem_of(*(str(about.get(key, "")) for key in ("target", "goals", "command")))
        with reading_past(store, run):
            results = read_run_results(begun, problem, journal.lines(run, kinds=RESULT_KINDS))
            subjects = tuple(dict.fromkeys(str(chain.subject) for chain in problem.chains))
            if not results.measured:
                return Told(results, None, subjects)
            lines_told = list(journal.lines(run, kinds=SURVEY_KIND_NAMES))
    placed = [
        (line.content, line.at_ms) for line in lines_told if line.kind == RecordKind.ALIGNMENT.value
    ]
    given_up = list(_given_up(lines_told))
    spoilt = spoilt_in(
        (line.content, line.at_ms) for line in lines_told if line.kind == RecordKind.WORLD.value
    )
    again = _repeat_reasons(
        line.content for line in lines_told if line.kind == RecordKind.DECISION.value
    )
    surveyed = inspection.survey_run(
        problem, results, placed, given_up, _impossible_goals(problem), spoilt, again
    )
    return Told(results, surveyed, subjects)


def _given_up(told: Iterable[JournalLine]) -> Iterator[tuple[str, str]]:
    """The goals that were given up, each with its reason: before a plan was made, or while it
    was carried out.
    """
    for line in told:
        if line.kind == RecordKind.PLAN.value:
            yield from ((goal, why) for goal, why in line.content.get("given_up", ()))
        elif line.kind == RecordKind.GIVEN_UP.value:
            yield line.content["goal"], line.content["why"]


def _repeat_reasons(decisions: Iterable[Mapping[str, Any]]) -> dict[str, list[str]]:
    """Why measurements were made again, by name, as decisions of a run say."""
    reasons: dict[str, list[str]] = {}
    for content in decisions:
        for name, entry in content.get("again", {}).items():
            reasons.setdefault(name, []).append(entry["why"])
    return reasons


def _impossible_goals(problem: Problem) -> Mapping[str, str]:
    return partition_by_tool(problem).impossible if chooses_tools(problem.domain) else {}


def read_run_results(begun: Begun, problem: Problem, lines: Iterable[JournalLine]) -> Results:
    """The results in the lines of a journal."""
    reader = _Reader(problem)
    for line in lines:
        reader.take(line)
    return Results(begun.run, begun.begun, tuple(reader.measured), tuple(reader.history))


@dataclass
class _Reader:
    """Reads a journal line by line.

    A value counts when its step is done: other replies are exceptions.
    """

    problem: Problem
    measured: list[Measured] = field(default_factory=list)
    history: list[Treated] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.replies: dict[int, str] = {}
        domain = self.problem.domain
        named = {**domain.objects, **self.problem.objects}
        closed = {
            name for name, type_entry in domain.types.items() if type_entry.constants
        }  # settings, not things
        self.objects = {name for name, type_ in named.items() if type_ not in closed}
        self.measuring = MeasurementJudge(self.problem)

    def take(self, line: JournalLine) -> None:
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
        for name_in_step in dict.fromkeys(
            name for name in _argument_names(step) if name in self.objects
        ):
            own = tuple(
                change
                for change in changes
                if name_in_step in set(_argument_names(ground_term(change)))
            )
            self.history.append(
                Treated(name_in_step, str(step), content["started_ms"], line.at_ms, own)
            )

    def _measure(self, step: Function, reply: str, at_ms: int) -> None:
        measured_value = self.measuring.heard(step, reply, at_ms) if reply else None
        if measured_value is not None:
            self.measured.append(measured_value)


def _argument_names(term: Term) -> Iterator[str]:
    """The names in the arguments of a term, those of compound terms as a whole and in their
    parts.
    """
    for argument in term.arguments if isinstance(term, Function) else ():
        yield str(argument)
        yield from _argument_names(argument)
