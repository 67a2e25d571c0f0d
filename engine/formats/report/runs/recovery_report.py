"""Recovery after a diagnosis, and revised plans with what was kept, as text and as data."""

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any, Protocol

from rich.console import Group, RenderableType
from rich.text import Text

from cellwright.engine.formats.report import json_answers, rich_parts
from cellwright.engine.formats.report.measurements import sequence_progress
from cellwright.engine.formats.report.plans import outcome_tables
from cellwright.engine.formats.report.plans import outcome_tables as outcomes
from cellwright.engine.model.noun_wording import count_noun, name_with_meaning
from cellwright.engine.model.outcome import Outcome
from cellwright.engine.model.troubleshooting import PreparationSteps
from cellwright.kb.model.plan_model import Step
from cellwright.kb.model.planning_problem import Problem

RECOVERY_WAYS = {
    "planned": "planned from the revised state",
    "done": "nothing is left to do",
    "continued": "the failed plan is continued",
    "repaired": "the failed plan is repaired",
    "replanned": "planned anew: no repair was found, or a new plan is cheaper",
}
PARTLY = "planned anew, for the goals that can still be reached"


class GoalGivenUp(Protocol):
    """A goal that is not planned for, and why."""

    @property
    def goal(self) -> str: ...
    @property
    def why(self) -> str: ...


class RecoveryRepair(Protocol):
    """A repair with which a recovery begins, and the steps that prepare it."""

    @property
    def name(self) -> str: ...
    @property
    def say(self) -> str: ...
    @property
    def prepared(self) -> PreparationSteps: ...


class PlannedRecovery(Protocol):
    """A plan for the rest, how it was made, how it differs from the failed plan, and the
    changes of a kept sequence.
    """

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
    def given_up(self) -> Sequence[GoalGivenUp]: ...
    @property
    def repair(self) -> RecoveryRepair | None: ...
    @property
    def sequence(self) -> sequence_progress.SequenceProgress | None: ...


def recovery_entry(recovery: PlannedRecovery) -> dict[str, Any]:
    """A recovery, for JSON."""
    content: dict[str, Any] = {
        "status": json_answers.outcome_status(recovery.outcome),
        "way": recovery.way,
        **json_answers.outcome_entry(recovery.outcome, recovery.problem),
    }
    if recovery.way != "planned":
        parts = {"kept": recovery.kept, "dropped": recovery.dropped, "added": recovery.added}
        content["revision"] = {
            name: [str(step.operator) for step in steps] for name, steps in parts.items()
        }
    if recovery.repair is not None:
        steps = [str(step.operator) for step in recovery.repair.prepared.steps]
        content["repair"] = {"name": recovery.repair.name, "steps": steps}
    if recovery.given_up:
        content["given_up"] = given_up_entry(recovery.given_up)
    if recovery.sequence is not None:
        content["sequence"] = sequence_progress.sequence_entry(recovery.sequence)
    return content


def recovery_text(recovery: PlannedRecovery) -> RenderableType:
    """How the plan was made, the plan, and the kept sequence."""
    way_text = PARTLY if recovery.given_up else RECOVERY_WAYS[recovery.way]
    if recovery.way != "planned":
        way_text += (
            f": {count_noun(len(recovery.kept), 'step')} kept, {len(recovery.dropped)} dropped, "
            f"{len(recovery.added)} added"
        )
    first = [Text(line) for line in _repair_lines(recovery.repair)]
    shown: list[RenderableType] = [
        *first,
        Text(way_text),
        outcomes.outcome_text(recovery.outcome, recovery.problem),
    ]
    shown += [
        Text(line)
        for line in given_up_lines(
            (given_up_goal.goal, given_up_goal.why) for given_up_goal in recovery.given_up
        )
    ]
    if recovery.sequence is not None:
        shown += [
            Text("the kept sequence was updated:"),
            sequence_progress.sequence_text(recovery.sequence),
        ]
    return Group(*shown)


def _repair_lines(repair: RecoveryRepair | None) -> list[str]:
    if repair is None:
        return []
    steps = [str(step.operator) for step in repair.prepared.steps]
    before = [f"before it: {'; '.join(steps)}"] if steps else []
    return [f"first, the repair {name_with_meaning(repair.name, repair.say)}", *before]


def given_up_entry(given_up_goals: Sequence[GoalGivenUp]) -> dict[str, str]:
    """The goals that are given up, each with the reason."""
    return {given_up_goal.goal: given_up_goal.why for given_up_goal in given_up_goals}


def given_up_lines(given_up_goals: Iterable[tuple[str, str]]) -> list[str]:
    """The goals that are given up, for people: each reason once, behind all its goals."""
    goals: dict[str, list[str]] = {}
    for goal, why in given_up_goals:
        goals.setdefault(why, []).append(goal)
    return [f"given up: {', '.join(named)}: {why}" for why, named in goals.items()]


if TYPE_CHECKING:
    from rich.console import RenderableType

    from cellwright.engine.pipelines.recovery.plan_revision import PlanRevision
    from cellwright.kb.terms import Atom

    Follows = tuple[tuple[Atom, bool], ...]


def revision_entry(revision: "PlanRevision", follows: "Follows") -> dict[str, Any]:
    """The revision as data: the steps kept, dropped and added, and what follows from what was
    observed.
    """

    parts = {"kept": revision.kept, "dropped": revision.dropped, "added": revision.added}
    return {
        "way": revision.way,
        **{name: [str(step.operator) for step in steps] for name, steps in parts.items()},
        "repair_cost": revision.repair_cost,
        "replanning_cost": revision.replanning_cost,
        "follows": {str(atom): holds for atom, holds in follows},
        "given_up": given_up_entry(revision.given_up),
    }


def revision_text(revision: "PlanRevision", follows: "Follows") -> "RenderableType":
    """The revision as people read it."""
    report_lines = [
        f"{revision.way}: {count_noun(len(revision.kept), 'step')} kept, "
        f"{len(revision.dropped)} dropped, {len(revision.added)} added"
    ]
    report_lines += [f"  - {step.operator}" for step in revision.dropped]
    report_lines += [f"  + {step.operator}" for step in revision.added]
    if revision.repair_cost is not None and revision.replanning_cost is not None:
        report_lines.append(
            f"repair costs {revision.repair_cost}, replanning {revision.replanning_cost}"
        )
    report_lines += [
        f"follows: {atom}" if holds else f"follows: not {atom}" for atom, holds in follows
    ]
    report_lines += given_up_lines(
        (given_up_goal.goal, given_up_goal.why) for given_up_goal in revision.given_up
    )
    return rich_parts.Group(
        outcome_tables.outcome_text(revision.outcome, revision.problem),
        rich_parts.Text("\n".join(report_lines)),
    )
