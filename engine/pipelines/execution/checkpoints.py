"""Checkpoints: records from which a run is taken up without reading what was written before them."""

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from engine.model.execution import Record, RecordKind
from engine.pipelines.execution.progress import Progress
from engine.pipelines.execution.records import read_atom
from engine.pipelines.execution.resuming import Past
from engine.pipelines.simulation import World
from kb.store.journal import Journal, Line


def state_of(course: Progress) -> dict[str, Any]:
    """What a checkpoint holds of a program on its way. The plan stays in its own record."""
    return {
        "facts": sorted(map(str, course.world.facts)),
        "reached": dict(course.world.reached),
        "plan": course.plan_number,
        "done": [list(each) for each in ranges(course.done)],
        "sent": [[entry, at_ms] for entry, at_ms in course.sent.values()],
        "number": course.standing.number,
        "since": [[str(atom), at_ms] for atom, at_ms in course.since.items() if atom in course.world.facts],
    }


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


def past_of(journal: Journal, run: str, past: Past, keeps_history: bool) -> Past:
    """What the journal says of a run, from its last checkpoint on if it has one."""
    number = journal.last(run, RecordKind.CHECKPOINT.value)
    state = _line(journal, run, number).content["state"] if number else {}
    if state.get("added"):
        number = 0  # a further command changes what the plans before it are for: all is read
    if number:
        for each in (1, state["plan"]):
            past.take(_record(_line(journal, run, each)))
        if keeps_history:
            for line in journal.lines(run, kinds=["done"]):
                if line.number < number:
                    past.did(_record(line))
        _restore(past, state)
    for line in journal.lines(run, max(0, number - 1)):
        past.take(_record(line))
    return past


def _restore(past: Past, state: Mapping[str, Any]) -> None:
    facts = {read_atom(each) for each in state["facts"]}
    past.world = World(past.scope.problem.chains, facts, dict(state["reached"]))
    past.done = {step: 0 for first, last in state["done"] for step in range(first, last + 1)}
    past.sent = {entry["command"]: (entry, at_ms) for entry, at_ms in state["sent"]}
    past.since = {read_atom(atom): at_ms for atom, at_ms in state.get("since", ())}
    past.cases = {(exception, step): count for exception, step, count in state["cases"]}
    past.number, past.forecast_ms = state["number"], state["forecast_ms"]
    past.exceptions, past.steps = state["exceptions"], state["steps"]


def _line(journal: Journal, run: str, number: int) -> Line:
    found = journal.line(run, number)
    assert found is not None  # lines count from 1 without gaps
    return found


def _record(line: Line) -> Record:
    return Record(line.number, line.at_ms, RecordKind(line.kind), line.content)
