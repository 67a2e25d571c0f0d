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
from cellwright.engine.pipelines.execution.record_shapes import (
    DamagedRecord,
    read_record,
    require_plan,
)
from cellwright.engine.pipelines.execution.run_progress import RunProgress
from cellwright.engine.pipelines.execution.run_resumption import PastRun
from cellwright.engine.pipelines.recovery import StepAchievement, SymbolicWorld
from cellwright.engine.pipelines.recovery.symbolic_world import achievement_of
from cellwright.engine.stages.execution.start_forecast import Accuracy
from cellwright.kb.garbage_collection import no_search_for_cycles
from cellwright.kb.store.journal import Journal

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
            past.take(_record_at(journal, run, 1))
            _restore_checkpoint(past, journal, run, number)
        for line in journal.lines(run, number):
            past.take(read_record(line))
    past.require_consistent()
    return past


def _last_state(journal: Journal, run: str) -> int:
    """The number of the last checkpoint; 0 if there is none. Pages of a plan behind it, which
    nothing refers to yet, are none.
    """
    number = journal.last(run, RecordKind.CHECKPOINT.value)
    while number and "state" not in _record_at(journal, run, number).content:
        number = journal.last(run, RecordKind.CHECKPOINT.value, before=number)
    return number


def _restore_checkpoint(past: PastRun, journal: Journal, run: str, number: int) -> None:
    record = _record_at(journal, run, number)
    state = record.content["state"]
    for addition in state["additions"]:
        past.extend(addition)
    if "lying" in state:
        past.lies(state["lying"])
    content = _recorded_plan(journal, run, state["plan"])
    past.follow(content, state["plan"])
    if "whole" in content:
        past.entire = partial(_whole_program, journal, run, content["whole"])
    _require_done_steps(state, content, number)
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
    past.at_ms = record.at_ms
    past.history = _recorded_history(journal, run, number)
    past.told = len(past.history)


def _require_done_steps(state: dict[str, Any], plan: dict[str, Any], number: int) -> None:
    """The steps that are done are those of the plan. Raises `DamagedRecord`."""
    known = {step["id"] for step in plan["steps"]}
    ranges = state["done"]
    many = sum(last - first + 1 for first, last in ranges)
    if (
        any(first > last for first, last in ranges)
        or many > len(known)
        or not all(step in known for first, last in ranges for step in range(first, last + 1))
    ):
        raise DamagedRecord(f"line {number} (checkpoint): `done` does not fit the plan")


def _recorded_plan(journal: Journal, run: str, number: int) -> dict[str, Any]:
    """The plan that a record holds, with the steps on the pages before it."""
    record = _record_at(journal, run, number)
    if record.kind is RecordKind.PLAN:
        return dict(record.content)
    pages = record.content.get("rest", {}).get("pages", 0)
    rest = [_rest_of(_record_at(journal, run, n)) for n in range(number - pages, number + 1)]
    plan = {**rest[-1], "steps": [step for page in rest for step in page["steps"]]}
    plan.pop("pages", None)
    require_plan(plan, f"line {number} ({record.kind})")
    return plan


def _rest_of(record: JournalRecord) -> dict[str, Any]:
    """What is left of a plan, on one page. Raises `DamagedRecord` if the record has none."""
    if record.kind is not RecordKind.CHECKPOINT or "rest" not in record.content:
        raise DamagedRecord(f"line {record.number} is referred to as what is left of a plan")
    return dict(record.content["rest"])


def _whole_program(journal: Journal, run: str, number: int) -> CompiledProgram:
    return compiled_of(_recorded_plan(journal, run, number))


def _recorded_history(journal: Journal, run: str, number: int) -> list[StepAchievement]:
    """What was done until a checkpoint that may matter to the fault base, in order."""
    parts = []
    while number:
        state = _state_at(journal, run, number)
        parts.append(state["history"])
        if state["before"] >= number:
            raise DamagedRecord(f"line {number} has a checkpoint before it that is behind it")
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


def _record_at(journal: Journal, run: str, number: int) -> JournalRecord:
    """The record of a number. Raises `DamagedRecord` if there is none that a run writes."""
    line = journal.line(run, number)
    if line is None:
        raise DamagedRecord(f"line {number} is referred to, and is not there")
    return read_record(line)


def _state_at(journal: Journal, run: str, number: int) -> dict[str, Any]:
    """The state in the checkpoint of a number. Raises `DamagedRecord` if there is none."""
    record = _record_at(journal, run, number)
    if record.kind is not RecordKind.CHECKPOINT or "state" not in record.content:
        raise DamagedRecord(f"line {number} is referred to as a checkpoint")
    return dict(record.content["state"])
