"""Checkpoints: records from which a run is taken up without reading what was written before them.

A checkpoint says how far the plan is. When a third of the steps is done that the journal holds of a long plan, records before it
hold those that are left, page by page, so what has to be read depends on what is left to do, not on how long the journal is. What was done
before, and may matter to the fault base, is in the chain of the checkpoints.
"""

from collections.abc import Iterable, Iterator
from functools import partial
from itertools import islice
from typing import Any

from cellwright.engine.model.execution import Record, RecordKind
from cellwright.engine.pipelines.execution.compiling import Compiled
from cellwright.engine.pipelines.execution.progress import Progress
from cellwright.engine.pipelines.execution.records import compiled_of, order_entry, read_atom, step_entries
from cellwright.engine.pipelines.execution.resuming import Past
from cellwright.engine.pipelines.simulation import Achievement, SymbolicWorld
from cellwright.engine.pipelines.simulation.world import achievement
from cellwright.engine.stages.execution.outlook import Accuracy
from cellwright.kb.cycles import no_search_for_cycles
from cellwright.kb.store.journal import Journal, Line

LONG = 1_000  # steps of a plan that is written anew when a part of it is done
PART = 3  # one of so many; all that is written so is at most twice the plan
PAGE = 1_000  # steps in a record


def state_of(course: Progress) -> dict[str, Any]:
    """What a checkpoint holds of a program on its way. Short plans stay in their own record."""
    held, standing = course.written, course.standing
    return {
        "facts": sorted(map(str, course.world.facts)),
        "reached": dict(course.world.reached),
        "plan": held.number,
        "done": [list(each) for each in ranges(held.done)],
        "ended": [
            [dwell.source, until - dwell.most_ms]
            for dwell, until in standing.dwelling.items()
            if dwell.source in held.done
        ],
        "sent": [[entry, at_ms] for entry, at_ms in course.sent.values()],
        "number": standing.number,
        "shares": list(course.accuracy.shares),
        "unrested": sorted(standing.unrested),
        "since": [[str(atom), at_ms] for atom, at_ms in course.since.items() if atom in course.world.facts],
        "before": held.checkpoint,
        "history": [_work_entry(each) for each in course.history[held.history :]],
        **({} if course.paths is None else course.paths.entry()),
    }


def rest_of(course: Progress) -> Iterator[dict[str, Any]]:
    """What is left of a long plan, page by page; nothing as long as most of what the journal holds of it is left.

    The last page is as the record of a plan, with the number of the record that has all of it, and how many pages are before it.
    """
    if not PART * len(course.written.done) >= course.written.steps >= LONG:
        return
    ended = {
        dwell.source: until - dwell.most_ms
        for dwell, until in course.standing.dwelling.items()
        if dwell.source in course.done
    }
    head = {"whole": course.written.number, **course.written.head}
    left, pages = step_entries(course.compiled, course.done), 0
    page = list(islice(left, PAGE))
    while following := list(islice(left, PAGE)):
        yield {"steps": page}
        page, pages = following, pages + 1
    yield {**head, "steps": page, "pages": pages, **order_entry(course.compiled, course.done, ended)}


def _work_entry(work: Achievement) -> list[Any]:
    return [str(work.step), [*map(str, work.added)], [[chain, n, str(atom)] for chain, n, atom in work.moved]]


def ranges(numbers: Iterable[int]) -> Iterator[tuple[int, int]]:
    """Whole numbers as ranges, both ends included."""
    first = last = None
    for each in sorted(numbers):
        if last is not None and first is not None and each == last + 1:
            last = each
            continue
        if first is not None and last is not None:
            yield first, last
        first = last = each
    if first is not None and last is not None:
        yield first, last


def past_of(journal: Journal, run: str, past: Past) -> Past:
    """What the journal says of a run, from its last checkpoint on if it has one."""
    number = _last_state(journal, run)
    with no_search_for_cycles():
        if number:
            past.take(_record(_line(journal, run, 1)))
            _restore(past, journal, run, number)
        for line in journal.lines(run, number):
            past.take(_record(line))
    return past


def _last_state(journal: Journal, run: str) -> int:
    """The number of the last checkpoint; 0 if there is none. Pages of a plan behind it, which nothing refers to yet, are none."""
    number = journal.last(run, RecordKind.CHECKPOINT.value)
    while number and "state" not in _line(journal, run, number).content:
        number = journal.last(run, RecordKind.CHECKPOINT.value, before=number)
    return number


def _restore(past: Past, journal: Journal, run: str, number: int) -> None:
    line = _line(journal, run, number)
    state = line.content["state"]
    for each in state["additions"]:
        past.extend(each)
    if "lying" in state:
        past.lies(state["lying"])
    content = _plan(journal, run, state["plan"])
    past.follow(content, state["plan"])
    if "whole" in content:
        past.entire = partial(_whole, journal, run, content["whole"])
    facts = {read_atom(each) for each in state["facts"]}
    past.world = SymbolicWorld(past.scope.problem.chains, facts, dict(state["reached"]))
    past.done = {step: 0 for first, last in state["done"] for step in range(first, last + 1)}
    past.done |= dict(state["ended"])
    past.sent = {entry["command"]: (entry, at_ms) for entry, at_ms in state["sent"]}
    past.since = {read_atom(atom): at_ms for atom, at_ms in state["since"]}
    past.cases = {(exception, step): count for exception, step, count in state["cases"]}
    past.unrested = frozenset(state.get("unrested", ()))
    past.met, past.arms = dict(state.get("met", {})), dict(state.get("arms", {}))
    past.accuracy = Accuracy(tuple(state.get("shares", ())))
    past.number, past.forecast_ms = state["number"], state["forecast_ms"]
    past.exceptions, past.steps = state["exceptions"], state["steps"]
    past.last = past.checkpoint = number
    past.at_ms = line.at_ms
    past.history = _history(journal, run, number)
    past.told = len(past.history)


def _plan(journal: Journal, run: str, number: int) -> dict[str, Any]:
    """The plan that a record holds, with the steps on the pages before it."""
    held = _line(journal, run, number)
    if held.kind != RecordKind.CHECKPOINT.value:
        return dict(held.content)
    rest = dict(held.content["rest"])
    if pages := rest.pop("pages", 0):
        before = islice(journal.lines(run, number - 1 - pages), pages)
        rest["steps"] = [step for page in before for step in page.content["rest"]["steps"]] + rest["steps"]
    return rest


def _whole(journal: Journal, run: str, number: int) -> Compiled:
    return compiled_of(_line(journal, run, number).content)


def _history(journal: Journal, run: str, number: int) -> list[Achievement]:
    """What was done until a checkpoint that may matter to the fault base, in order."""
    parts = []
    while number:
        state = _line(journal, run, number).content["state"]
        parts.append(state["history"])
        number = state["before"]
    found = list[Achievement]()
    for step, added, moved in (each for part in reversed(parts) for each in part):
        moves = [(chain, n, read_atom(atom)) for chain, n, atom in moved]
        found.append(achievement(len(found) + 1, read_atom(step), map(read_atom, added), moves))
    return found


def _line(journal: Journal, run: str, number: int) -> Line:
    found = journal.line(run, number)
    assert found is not None  # lines count from 1 without gaps
    return found


def _record(line: Line) -> Record:
    return Record(line.number, line.at_ms, RecordKind(line.kind), line.content)
