"""The recovery after a diagnosis, for people and programs."""

from collections.abc import Iterable, Sequence
from typing import Any, Protocol

from rich.console import Group, RenderableType
from rich.text import Text

from cellwright.engine.formats.report import json, progress
from cellwright.engine.formats.report import text as outcomes
from cellwright.engine.model.cases import Prepared
from cellwright.engine.model.outcome import Outcome
from cellwright.engine.model.wording import counted, worded
from cellwright.kb.model.plan import Step
from cellwright.kb.model.problem import Problem

WAYS = {
    "planned": "planned from the revised state",
    "done": "nothing is left to do",
    "continued": "the failed plan is continued",
    "repaired": "the failed plan is repaired",
    "replanned": "planned anew: no repair was found, or a new plan is cheaper",
}
PARTLY = "planned anew, for the goals that can still be reached"


class GivenUp(Protocol):
    """A goal that is not planned for, and why."""

    @property
    def goal(self) -> str: ...
    @property
    def why(self) -> str: ...


class FirstRepair(Protocol):
    """A repair with which a recovery begins, and the steps that prepare it."""

    @property
    def name(self) -> str: ...
    @property
    def say(self) -> str: ...
    @property
    def prepared(self) -> Prepared: ...


class Recovery(Protocol):
    """A plan for the rest, how it was made, how it differs from the failed plan, and the changes of a kept sequence."""

    @property
    def problem(self) -> Problem: ...
    @property
    def outcome(self) -> Outcome: ...
    @property
    def way(self) -> str: ...
    @property
    def kept(self) -> Sequence[Step]: ...
    @property
    def dropped(self) -> Sequence[Step]: ...
    @property
    def added(self) -> Sequence[Step]: ...
    @property
    def given_up(self) -> Sequence[GivenUp]: ...
    @property
    def repair(self) -> FirstRepair | None: ...
    @property
    def sequence(self) -> progress.Progress | None: ...


def entry(found: Recovery) -> dict[str, Any]:
    """A recovery, for JSON."""
    content: dict[str, Any] = {
        "status": json.status(found.outcome),
        "way": found.way,
        **json.outcome(found.outcome, found.problem),
    }
    if found.way != "planned":
        parts = {"kept": found.kept, "dropped": found.dropped, "added": found.added}
        content["revision"] = {name: [str(step.operator) for step in steps] for name, steps in parts.items()}
    if found.repair is not None:
        steps = [str(step.operator) for step in found.repair.prepared.steps]
        content["repair"] = {"name": found.repair.name, "steps": steps}
    if found.given_up:
        content["given_up"] = given_up_entry(found.given_up)
    if found.sequence is not None:
        content["sequence"] = progress.entry(found.sequence)
    return content


def text(found: Recovery) -> RenderableType:
    """How the plan was made, the plan, and the kept sequence."""
    said = PARTLY if found.given_up else WAYS[found.way]
    if found.way != "planned":
        said += f": {counted(len(found.kept), 'step')} kept, {len(found.dropped)} dropped, {len(found.added)} added"
    first = [Text(line) for line in _first(found.repair)]
    shown: list[RenderableType] = [*first, Text(said), outcomes.outcome(found.outcome, found.problem)]
    shown += [Text(line) for line in given_up_lines((each.goal, each.why) for each in found.given_up)]
    if found.sequence is not None:
        shown += [Text("the kept sequence was updated:"), progress.text(found.sequence)]
    return Group(*shown)


def _first(repair: FirstRepair | None) -> list[str]:
    if repair is None:
        return []
    steps = [str(step.operator) for step in repair.prepared.steps]
    before = [f"before it: {'; '.join(steps)}"] if steps else []
    return [f"first, the repair {worded(repair.name, repair.say)}", *before]


def given_up_entry(found: Sequence[GivenUp]) -> dict[str, str]:
    """The goals that are given up, each with the reason."""
    return {each.goal: each.why for each in found}


def given_up_lines(found: Iterable[tuple[str, str]]) -> list[str]:
    """The goals that are given up, for people: each reason once, behind all its goals."""
    goals: dict[str, list[str]] = {}
    for goal, why in found:
        goals.setdefault(why, []).append(goal)
    return [f"given up: {', '.join(named)}: {why}" for why, named in goals.items()]
