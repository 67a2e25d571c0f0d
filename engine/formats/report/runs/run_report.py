"""A run as text: how it ended, and its records narrated in plain lines."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from rich.console import Group, RenderableType
from rich.text import Text

from cellwright.engine.formats.report.runs.recovery_report import given_up_lines
from cellwright.engine.model.noun_wording import count_noun
from cellwright.engine.model.run_protocol import JournalRecord, RecordKind
from cellwright.kb.model.conditions import goal_parts
from cellwright.kb.model.planning_problem import Problem

if TYPE_CHECKING:
    from cellwright.engine.model.run_protocol import Finish

ENDING_WORDS = {
    "reached": "all goals are reached",
    "partly": "not all goals could be reached",
    "stopped": "stopped safely",
    "aborted": "ended before its goals were reached",
    "paused": "paused",
}
MAX_RUN_GOALS = 12  # goals that are listed


def ending_entry(ending: "Finish") -> dict[str, Any]:
    """The ending as JSON."""
    return {
        "run": ending.run,
        "why": ending.why,
        "goals": list(ending.goals),
        "open_goals": list(ending.open_goals),
        "given_up": [{"goal": goal, "why": why} for goal, why in ending.given_up],
        "makespan_ms": ending.makespan_ms,
        "forecast_ms": ending.forecast_ms,
        "exceptions": ending.exceptions,
        "steps": ending.steps,
        "story": list(ending.story),
    }


def ending_text(ending: "Finish", store: str) -> RenderableType:
    """The ending in a few lines."""
    why = f": {ending.why}" if ending.why else ""
    lines = [Text(f"Run {ending.run}: {ENDING_WORDS[ending.outcome]}{why}.")]
    took = (
        f"{duration_text(ending.makespan_ms)} on the run's clock; the first plan was forecast "
        f"to take {duration_text(ending.forecast_ms)}"
    )
    lines.append(
        Text(
            f"{count_noun(ending.steps, 'step')}, {count_noun(ending.exceptions, 'exception')}, "
            f"{took}."
        )
    )
    lines += [Text(f"  {story_line}") for story_line in ending.story]
    lines += [Text(f"  {given_up_line}") for given_up_line in given_up_lines(ending.given_up)]
    told_goals = {goal for goal, _ in ending.given_up}
    still = [goal for goal in ending.open_goals if goal not in told_goals]
    lines += [Text(f"  open: {goal}") for goal in still[:MAX_RUN_GOALS]]
    if len(still) > MAX_RUN_GOALS:
        lines.append(Text(f"  ... and {len(still) - MAX_RUN_GOALS} more: --format json names all"))
    if ending.outcome in ("stopped", "paused"):
        lines.append(Text(f"Go on with: cellwright resume {ending.run} --store {store}"))
    return Group(*lines)


def clock_time(ms: int) -> str:
    """A moment of a run as hours, minutes and seconds: 0:28:27."""
    minutes, seconds = divmod(round(ms / 1000), 60)
    return f"{minutes // 60}:{minutes % 60:02}:{seconds:02}"


def duration_text(ms: int) -> str:
    """A time in the units that people use, to the second above two minutes."""
    if ms < 120_000:
        return f"{ms / 1000:g} s"
    minutes, seconds = divmod(round(ms / 1000), 60)
    return (
        f"{minutes} min {seconds} s" if minutes < 120 else f"{minutes // 60} h {minutes % 60} min"
    )


MAX_WANTED_GOALS = 8  # goals that are listed
Content = Mapping[str, Any]


def narrate_record(record: JournalRecord) -> list[str]:
    """What a record tells a person; empty if nothing that the others do not tell."""
    tell = _NARRATORS.get(record.kind)
    return [] if tell is None else list(tell(record.content, duration_text(record.at_ms)))


def narrate_problem(problem: Problem) -> list[str]:
    """What a problem wants, in plain lines: its chains of stages, and its goals."""
    goal_lines = [", then ".join(map(str, chain.stages)) for chain in problem.chains]
    goal_lines += [str(goal_part) for goal_part in goal_parts(problem.goal)]
    more = (
        [f"  and {len(goal_lines) - MAX_WANTED_GOALS} more"]
        if len(goal_lines) > MAX_WANTED_GOALS
        else []
    )
    return ["Wanted:", *(f"  {goal_line}" for goal_line in goal_lines[:MAX_WANTED_GOALS]), *more]


def _narrate_plan(content: Content, now: str) -> Iterator[str]:
    devices = {plan_step["stream"] for plan_step in content["steps"]}
    many = f"{count_noun(len(content['steps']), 'step')} on {count_noun(len(devices), 'device')}"
    if content["why"] != "first":
        yield (
            f"{now}: goes on with another plan ({content['why']}): {many}, forecast to end at "
            f"{duration_text(content['forecast_ms'])}"
        )
        return
    yield f"Planned and scheduled: {many}, forecast to take {duration_text(content['forecast_ms'])}"
    yield "Carried out:"


def _narrate_exception(content: Content, now: str) -> Iterator[str]:
    yield f"{now}: EXCEPTION {content['exception']}: {content['action']}: {content['reply']}"


def _narrate_finding(content: Content, now: str) -> Iterator[str]:
    yield f"{now}:   {content['action']}: {content['outcome']}"


def _narrate_diagnosis(content: Content, now: str) -> Iterator[str]:
    causes = ", or ".join(
        f"{cause} ({round(100 * p)} %)" for cause, p in content["causes"][:2] if p >= 0.005
    )
    cured = content["cured"]
    helped = (
        f"; put right by {cured}"
        if isinstance(cured, str) and cured
        else "; put right"
        if cured
        else ""
    )
    yield f"{now}:   diagnosed: {causes or 'none of the known causes'}{helped}"


def _narrate_world(content: Content, now: str) -> Iterator[str]:
    changes = [*content["adds"], *(f"not {ended_fact}" for ended_fact in content["ends"])]
    if changes:
        yield f"{now}:   the world model is corrected: {_some_names(changes)}"


def _narrate_goal(content: Content, now: str) -> Iterator[str]:
    yield f"{now}: reached {content['goal']}"


def _given_up(content: Content, now: str) -> Iterator[str]:
    yield f"{now}: gives up {content['goal']}: {content['why']}"


def _narrate_trouble(content: Content, now: str) -> Iterator[str]:
    yield f"{now}: trouble with the controller ({content['trouble']}): {content['text']}"


def _narrate_order(content: Content, now: str) -> Iterator[str]:
    yield (
        f"{now}: order from the {content['origin']}: {content['order']} {content['given']}"
    ).rstrip()


def _narrate_phase(content: Content, now: str) -> Iterator[str]:
    if content["phase"] in ("ready", "paused"):  # a stop is told by the end of the run
        yield f"{now}: {content['phase']}: {content['why']}"


def _narrate_decision(content: Content, now: str) -> Iterator[str]:
    yield f"{now}: {content['what']}: {content['why']}"


def _narrate_end(content: Content, now: str) -> Iterator[str]:
    why = f": {content['why']}" if content["why"] else ""
    yield f"{now}: {ENDING_WORDS[content['outcome']]}{why}"


def _some_names(listed: Sequence[str]) -> str:
    return ", ".join(listed[:4]) + (f" and {len(listed) - 4} more" if len(listed) > 4 else "")


_NARRATORS: Mapping[RecordKind, Callable[[Content, str], Iterator[str]]] = {
    RecordKind.PLAN: _narrate_plan,
    RecordKind.EXCEPTION: _narrate_exception,
    RecordKind.FINDING: _narrate_finding,
    RecordKind.DIAGNOSIS: _narrate_diagnosis,
    RecordKind.WORLD: _narrate_world,
    RecordKind.GOAL: _narrate_goal,
    RecordKind.GIVEN_UP: _given_up,
    RecordKind.TROUBLE: _narrate_trouble,
    RecordKind.ORDER: _narrate_order,
    RecordKind.PHASE: _narrate_phase,
    RecordKind.DECISION: _narrate_decision,
    RecordKind.END: _narrate_end,
}
