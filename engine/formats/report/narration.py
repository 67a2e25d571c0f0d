"""A run in plain lines: what is wanted, each plan, what went wrong, what was found, what was put right, and the end."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from cellwright.engine.formats.report.execution import SAID, duration
from cellwright.engine.model.execution import Record, RecordKind
from cellwright.engine.model.wording import counted
from cellwright.kb.model.conditions import goal_parts
from cellwright.kb.model.problem import Problem

WANTED = 8  # goals that are listed
Content = Mapping[str, Any]


def narrated(record: Record) -> list[str]:
    """What a record tells a person; empty if nothing that the others do not tell."""
    tell = _TELLERS.get(record.kind)
    return [] if tell is None else list(tell(record.content, duration(record.at_ms)))


def understood(problem: Problem) -> list[str]:
    """What a problem wants, in plain lines: its chains of stages, and its goals."""
    wanted = [", then ".join(map(str, chain.stages)) for chain in problem.chains]
    wanted += [str(each) for each in goal_parts(problem.goal)]
    more = [f"  and {len(wanted) - WANTED} more"] if len(wanted) > WANTED else []
    return ["Wanted:", *(f"  {each}" for each in wanted[:WANTED]), *more]


def _plan(content: Content, now: str) -> Iterator[str]:
    devices = {each["stream"] for each in content["steps"]}
    many = f"{counted(len(content['steps']), 'step')} on {counted(len(devices), 'device')}"
    if content["why"] != "first":
        yield f"{now}: goes on with another plan ({content['why']}): {many}, forecast to end at {duration(content['forecast_ms'])}"
        return
    yield f"Planned and scheduled: {many}, forecast to take {duration(content['forecast_ms'])}"
    yield "Carried out:"


def _exception(content: Content, now: str) -> Iterator[str]:
    yield f"{now}: EXCEPTION {content['exception']}: {content['action']}: {content['reply']}"


def _finding(content: Content, now: str) -> Iterator[str]:
    yield f"{now}:   {content['action']}: {content['outcome']}"


def _diagnosis(content: Content, now: str) -> Iterator[str]:
    causes = ", or ".join(f"{cause} ({round(100 * p)} %)" for cause, p in content["causes"][:2] if p >= 0.005)
    cured = content["cured"]
    helped = f"; put right by {cured}" if isinstance(cured, str) and cured else "; put right" if cured else ""
    yield f"{now}:   diagnosed: {causes or 'none of the known causes'}{helped}"


def _world(content: Content, now: str) -> Iterator[str]:
    changes = [*content["adds"], *(f"not {each}" for each in content["ends"])]
    if changes:
        yield f"{now}:   the world model is corrected: {_some(changes)}"


def _goal(content: Content, now: str) -> Iterator[str]:
    yield f"{now}: reached {content['goal']}"


def _given_up(content: Content, now: str) -> Iterator[str]:
    yield f"{now}: gives up {content['goal']}: {content['why']}"


def _trouble(content: Content, now: str) -> Iterator[str]:
    yield f"{now}: trouble with the controller ({content['trouble']}): {content['text']}"


def _order(content: Content, now: str) -> Iterator[str]:
    yield f"{now}: order from the {content['origin']}: {content['order']} {content['given']}".rstrip()


def _phase(content: Content, now: str) -> Iterator[str]:
    if content["phase"] in ("ready", "paused"):  # a stop is told by the end of the run
        yield f"{now}: {content['phase']}: {content['why']}"


def _decision(content: Content, now: str) -> Iterator[str]:
    yield f"{now}: {content['what']}: {content['why']}"


def _end(content: Content, now: str) -> Iterator[str]:
    why = f": {content['why']}" if content["why"] else ""
    yield f"{now}: {SAID[content['outcome']]}{why}"


def _some(listed: Sequence[str]) -> str:
    return ", ".join(listed[:4]) + (f" and {len(listed) - 4} more" if len(listed) > 4 else "")


_TELLERS: Mapping[RecordKind, Callable[[Content, str], Iterator[str]]] = {
    RecordKind.PLAN: _plan,
    RecordKind.EXCEPTION: _exception,
    RecordKind.FINDING: _finding,
    RecordKind.DIAGNOSIS: _diagnosis,
    RecordKind.WORLD: _world,
    RecordKind.GOAL: _goal,
    RecordKind.GIVEN_UP: _given_up,
    RecordKind.TROUBLE: _trouble,
    RecordKind.ORDER: _order,
    RecordKind.PHASE: _phase,
    RecordKind.DECISION: _decision,
    RecordKind.END: _end,
}
