"""Checkpoints: journal records from which a run is resumed without reading those before them.

A checkpoint says how far the plan is. When a third of the steps is done that the journal holds of a
long plan, records before it hold those that are left, page by page, so what has to be read depends
on what is left to do, not on how long the journal is. What was done before, and may matter to the
fault base, is in the chain of the checkpoints.
"""

from collections.abc import Iterable, Iterator
from functools import partial
from itertools import islice
from typing import Any

from cellwright.engine.model.run_protocol import JournalRecord, RecordKind
from cellwright.engine.pipelines.execution.compiled_program import CompiledProgram
from cellwright.engine.pipelines.execution.plan_records import (
    compiled_of,
    order_entry,
    read_ground_atom,
    step_entries,
)
from cellwright.engine.pipelines.execution.run_progress import RunProgress
from cellwright.engine.pipelines.execution.run_resumption import PastRun
from cellwright.engine.pipelines.recovery import StepAchievement, SymbolicWorld
from cellwright.engine.pipelines.recovery.symbolic_world import achievement_of
from cellwright.engine.stages.execution.start_forecast import Accuracy
from cellwright.kb.garbage_collection import no_search_for_cycles
from cellwright.kb.store.journal import Journal, JournalLine

MIN_PAGED_STEPS = 1_000  # steps of a plan that is written anew when a part of it is done
REWRITTEN_PART = 3  # one of so many; all that is written so is at most twice the plan
STEPS_PER_PAGE = 1_000  # steps in a record


def state_of(course: RunProgress) -> dict[str, Any]:
    """What a checkpoint holds of a program on its way. Short plans stay in their own record."""
    written, standing = course.written, course.standing
    return {
        "facts": sorted(map(str, course.world.facts)),
        "reached": dict(course.world.reached),
        "plan": written.number,
        "done": [list(span) for span in number_ranges(written.done)],
        "ended": [
            [dwell.source, until - dwell.most_ms]
            for dwell, until in standing.dwelling.items()
            if dwell.source in written.done
        ],
        "sent": [[entry, at_ms] for entry, at_ms in course.sent.values()],
        "number": standing.number,
        "shares": list(course.accuracy.shares),
        "unrested": sorted(standing.unrested),
        "since": [
            [str(atom), at_ms] for atom, at_ms in course.since.items() if atom in course.world.facts
        ],
        "before": written.checkpoint,
        "history": [_work_entry(work) for work in course.history[written.history :]],
        **({} if course.paths is None else course.paths.entry()),
    }


def remaining_pages(course: RunProgress) -> Iterator[dict[str, Any]]:
    """What is left of a long plan, page by page; nothing as long as most of what the journal holds
    of it is left.

    The last page is as the record of a plan, with the number of the record that has all of it, and
    how many pages are before it.
    """
    if not REWRITTEN_PART * len(course.written.done) >= course.written.steps >= MIN_PAGED_STEPS:
        return
    ended = {
        dwell.source: until - dwell.most_ms
        for dwell, until in course.standing.dwelling.items()
        if dwell.source in course.done
    }
    head = {"whole": course.written.number, **course.written.head}
    step_pages, pages = step_entries(course.compiled, course.done), 0
    page = list(islice(step_pages, STEPS_PER_PAGE))
    while following := list(islice(step_pages, STEPS_PER_PAGE)):
        yield {"steps": page}
        page, pages = following, pages + 1
    yield {
        **head,
        "steps": page,
        "pages": pages,
        **order_entry(course.compiled, course.done, ended),
    }


def _work_entry(work: StepAchievement) -> list[Any]:
    return [
        str(work.step),
        [*map(str, work.added)],
        [[chain, n, str(atom)] for chain, n, atom in work.moved],
    ]


def number_ranges(numbers: Iterable[int]) -> Iterator[tuple[int, int]]:
    """Whole numbers as ranges, both ends included."""
    first = last = None
    for number in sorted(numbers):
        if last is not None and first is not None and number == last + 1:
            last = number
            continue
        if first is not None and last is not None:
            yield first, last
        first = last = number
    if first is not None and last is not None:
        yield first, last


def past_of(journal: Journal, run: str, past: PastRun) -> PastRun:
    """What the journal says of a run, from its last checkpoint on if it has one."""
    number = _last_state(journal, run)
    with no_search_for_cycles():
        if number:
            past.take(_record_of(_journal_line(journal, run, 1)))
            _restore_checkpoint(past, journal, run, number)
        for line in journal.lines(run, number):
            past.take(_record_of(line))
    return past


def _last_state(journal: Journal, run: str) -> int:
    """The number of the last checkpoint; 0 if there is none. Pages of a plan behind it, which
    nothing refers to yet, are none.
    """
    number = journal.last(run, RecordKind.CHECKPOINT.value)
    while number and "state" not in _journal_line(journal, run, number).content:
        number = journal.last(run, RecordKind.CHECKPOINT.value, before=number)
    return number


def _restore_checkpoint(past: PastRun, journal: Journal, run: str, number: int) -> None:
    line = _journal_line(journal, run, number)
    state = line.content["state"]
    for addition in state["additions"]:
        past.extend(addition)
    if "lying" in state:
        past.lies(state["lying"])
    content = _recorded_plan(journal, run, state["plan"])
    past.follow(content, state["plan"])
    if "whole" in content:
        past.entire = partial(_whole_program, journal, run, content["whole"])
    facts = {read_ground_atom(fact) for fact in state["facts"]}
    past.world = SymbolicWorld(past.scope.problem.chains, facts, dict(state["reached"]))
    past.done = {step: 0 for first, last in state["done"] for step in range(first, last + 1)}
    past.done |= dict(state["ended"])
    past.sent = {entry["command"]: (entry, at_ms) for entry, at_ms in state["sent"]}
    past.since = {read_ground_atom(atom): at_ms for atom, at_ms in state["since"]}
    past.cases = {(exception, step): count for exception, step, count in state["cases"]}
    past.unrested = frozenset(state.get("unrested", ()))
    past.met, past.arms = dict(state.get("met", {})), dict(state.get("arms", {}))
    past.accuracy = Accuracy(tuple(state.get("shares", ())))
    past.number, past.forecast_ms = state["number"], state["forecast_ms"]
    past.exceptions, past.steps = state["exceptions"], state["steps"]
    past.last = past.checkpoint = number
    past.at_ms = line.at_ms
    past.history = _recorded_history(journal, run, number)
    past.told = len(past.history)


def _recorded_plan(journal: Journal, run: str, number: int) -> dict[str, Any]:
    """The plan that a record holds, with the steps on the pages before it."""
    line = _journal_line(journal, run, number)
    if line.kind != RecordKind.CHECKPOINT.value:
        return dict(line.content)
    rest = dict(line.content["rest"])
    if pages := rest.pop("pages", 0):
        before = islice(journal.lines(run, number - 1 - pages), pages)
        rest["steps"] = [step for page in before for step in page.content["rest"]["steps"]] + rest[
            "steps"
        ]
    return rest


def _whole_program(journal: Journal, run: str, number: int) -> CompiledProgram:
    return compiled_of(_journal_line(journal, run, number).content)


def _recorded_history(journal: Journal, run: str, number: int) -> list[StepAchievement]:
    """What was done until a checkpoint that may matter to the fault base, in order."""
    parts = []
    while number:
        state = _journal_line(journal, run, number).content["state"]
        parts.append(state["history"])
        number = state["before"]
    achievements = list[StepAchievement]()
    for step, added, moved in (work for part in reversed(parts) for work in part):
        moves = [(chain, n, read_ground_atom(atom)) for chain, n, atom in moved]
        achievements.append(
            achievement_of(
                len(achievements) + 1, read_ground_atom(step), map(read_ground_atom, added), moves
            )
        )
    return achievements


def _journal_line(journal: Journal, run: str, number: int) -> JournalLine:
    line = journal.line(run, number)
    assert line is not None  # lines count from 1 without gaps
    return line


def _record_of(line: JournalLine) -> JournalRecord:
    return JournalRecord(line.number, line.at_ms, RecordKind(line.kind), line.content)
