"""Inspector of a run: what an inspection does at the end of a plan, noted in the journal."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from cellwright.engine.model.noun_wording import count_noun
from cellwright.engine.model.outcome import Found
from cellwright.engine.model.run_protocol import RecordKind
from cellwright.engine.model.shape_fits import Alignment
from cellwright.engine.model.troubleshooting import Revision
from cellwright.engine.pipelines.execution.exception_handler import ExceptionHandler, GivesUp
from cellwright.engine.pipelines.execution.executable_plan import ReadyPlan, compile_ready_plan
from cellwright.engine.pipelines.execution.plan_records import read_ground_atom
from cellwright.engine.pipelines.execution.planner_choice import choose_and_plan
from cellwright.engine.pipelines.execution.remeasurement import (
    DatumLooks,
    Repeat,
    choose_repeats,
    datums_asked,
    facts_of,
    first_stage,
    judge_features,
    locate_part,
    looks_needed,
    move_points,
    reopen_measurements,
)
from cellwright.engine.pipelines.execution.run_goals import RunScope
from cellwright.engine.pipelines.execution.run_progress import RunProgress
from cellwright.engine.pipelines.inspection.part_alignment import PartAlignment, lying_of
from cellwright.engine.pipelines.inspection.spoilt_values import counting_values
from cellwright.engine.pipelines.recovery.replanning import recover_goals
from cellwright.engine.stages.planning import SearchLimits
from cellwright.kb.model.measured_results import Measured
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.store.journal import JournalLine

ALIGNED, AGAIN = "aligned", "again"  # reasons for another plan
DATUMS_MISFIT = "not_aligned"  # the reply that the fault base knows for datums that fit nowhere
MAX_REMEASURE_ROUNDS = 6  # of repeated measurements
MAX_LISTED_NAMES = 8  # names in a line


@dataclass(frozen=True, slots=True)
class FurtherPlan:
    """Another plan, and why it is followed."""

    ready: ReadyPlan
    why: str


def datums_first(first_plan: ReadyPlan, scope: RunScope) -> tuple[ReadyPlan, RunScope]:
    """A plan that ends with the datums of the part, if it has such; else the whole plan.

    What comes behind is planned when they are measured.
    """
    stage = first_stage(first_plan, scope)
    if stage is None:
        return first_plan, scope
    plan, narrow = stage
    starts = {step.id: first_plan.starts[step.id] for step in plan.steps}
    return replace(
        compile_ready_plan(scope.problem, plan, starts, 0), notes=first_plan.notes
    ), narrow


def measured_in(lines: Iterable[JournalLine]) -> list[Measured]:
    """The values that the results in a journal hold."""
    return [_measured_value(line) for line in lines if line.content.get("of") is not None]


def _measured_value(line: JournalLine) -> Measured:
    content = line.content
    numbers = (
        content["nominal"],
        content["lower"],
        content["upper"],
        content["tool"],
        content["action"],
        line.at_ms,
    )
    sure = (content.get("uncertainty"), content.get("risk"))
    return Measured(
        content["of"], content["quantity"], content["value"], content["unit"], *numbers, *sure
    )


def scope_of_located_part(whole: Problem, scope: RunScope, content: Mapping[str, Any]) -> RunScope:
    """The scope for all of a problem with its part where a record says, without what is lost or
    was given up.
    """
    located = RunScope(move_points(whole, lying_of(content, content["at_ms"])), scope.given_up)
    return located.changed(
        Revision(lost=scope.lost, blocked=tuple((pattern, "") for pattern in scope.blocked))
    )


@dataclass
class Inspector:
    """Follows one inspection.

    `entry` is the record that says where the part lies; empty as long as that is not known.
    """

    entry: dict[str, Any] = field(default_factory=dict)
    rounds: int = 0
    told: str = ""

    def taken_up(self, entry: Mapping[str, Any], course: RunProgress) -> None:
        """Go on where the part lies as a record of the run says."""
        self.entry = dict(entry)
        course.part = tuple(entry.get("part", ()))

    def _lying(self) -> PartAlignment | None:
        return lying_of(self.entry, self.entry["at_ms"]) if self.entry else None

    def onward(
        self, problem: Problem, course: RunProgress, handler: ExceptionHandler, limits: SearchLimits
    ) -> FurtherPlan | GivesUp | None:
        """What an inspection goes on with at the end of a plan; None if it is over. The scope
        of the handler is set to it.
        """
        if not any(value.uncertainty for value in course.values):
            return None
        if not self.entry and datums_asked(problem):
            return self._aligned(problem, course, handler, limits)
        return self._again(problem, course, handler, limits)

    def _aligned(
        self, problem: Problem, course: RunProgress, handler: ExceptionHandler, limits: SearchLimits
    ) -> FurtherPlan | GivesUp:
        names, alignment = locate_part(problem, counting_values(course.values, course.spoilt))
        if not isinstance(alignment, Alignment):
            course.recorder.note(
                RecordKind.ALIGNMENT, part=[], wrong=list(alignment.off), why=alignment.reason
            )
            return _diagnose_misfit(course, handler, alignment.off, alignment.reason)
        looks = looks_needed(problem, counting_values(course.values, course.spoilt), alignment)
        if looks is not None:
            return self._looked_at_again(looks, problem, course, handler, limits)
        content = {
            "part": [float(number) for number in alignment.T_measured_nominal[:3].ravel()],
            "centre": alignment.centre.tolist(),
            "covariance": alignment.covariance.tolist(),
            "datums": int(alignment.used.sum()),
            "wrong": [name for name, used in zip(names, alignment.used, strict=True) if not used],
        }
        record = course.recorder.note(RecordKind.ALIGNMENT, **content)
        self.taken_up({**content, "at_ms": record.at_ms}, course)
        handler.scope = scope_of_located_part(problem, handler.scope, self.entry)
        wrong: Sequence[str] = list(map(str, self.entry["wrong"]))
        _reopen_facts(course, wrong, problem, "these datums disagree with the others")
        return self._planned(
            course, handler, handler.scope.rest(course.world.state), limits, ALIGNED
        )

    def _looked_at_again(
        self,
        looks: DatumLooks,
        problem: Problem,
        course: RunProgress,
        handler: ExceptionHandler,
        limits: SearchLimits,
    ) -> FurtherPlan | GivesUp:
        """Measure datums once more, because the part is not known as well as it has to be; or
        give up if that would not help.
        """
        if looks.refused:
            course.recorder.note(RecordKind.ALIGNMENT, part=[], wrong=[], why=looks.refused)
            return GivesUp(looks.refused, stops=False)
        names = {name: {"why": looks.told, "tool": ""} for name in looks.names}
        what_again = f"measured again: {count_noun(len(names), 'datum')}"
        course.recorder.note(RecordKind.DECISION, what=what_again, why=looks.told, again=names)
        handler.story.append(f"{what_again}; {looks.told}")
        rest, facts = handler.scope.rest(course.world.state), course.world.facts
        again = reopen_measurements(rest, dict.fromkeys(names, ""), facts)
        _reopen_facts(course, list(names), problem, "they are measured again")
        return self._planned(course, handler, again, limits, AGAIN)

    def _again(
        self, problem: Problem, course: RunProgress, handler: ExceptionHandler, limits: SearchLimits
    ) -> FurtherPlan | None:
        if self.rounds >= MAX_REMEASURE_ROUNDS:
            return None
        features = judge_features(problem, course.values, self._lying(), course.spoilt)
        rest, facts = handler.scope.rest(course.world.state), course.world.facts
        repeat = choose_repeats(problem, features, rest, limits, facts)
        if repeat is None:
            return None
        if repeat.left and repeat.left != self.told:
            course.recorder.note(
                RecordKind.DECISION, what="some features stay undecided", why=repeat.left
            )
            self.told = repeat.left
        if not repeat.names:
            return None
        self.rounds += 1
        tools = {name: repeat.tools.get(name, "") for name in repeat.names}
        again = reopen_measurements(rest, tools, facts)
        _reopen_facts(course, list(repeat.names), problem, "they are measured again")
        names = {name: {"why": why, "tool": tools[name]} for name, why in repeat.names.items()}
        reason = "; ".join(text for text in (repeat.why, _reasons_text(repeat.names)) if text)
        course.recorder.note(
            RecordKind.DECISION, what=f"measured again: {repeat.what}", why=reason, again=names
        )
        handler.story.append(_repeat_text(repeat))
        made_ = self._planned(course, handler, again, limits, AGAIN)
        return made_ if isinstance(made_, FurtherPlan) else None

    def _planned(
        self,
        course: RunProgress,
        handler: ExceptionHandler,
        rest: Problem,
        limits: SearchLimits,
        why: str,
    ) -> FurtherPlan | GivesUp:
        """The plan for what is left. What cannot be reached is given up."""
        now, since = course.driver.now_ms(), course.since
        result = choose_and_plan(rest, limits, "")
        if isinstance(result.outcome, Found):
            return FurtherPlan(
                compile_ready_plan(rest, result.outcome.plan, result.starts, now, since=since), why
            )
        state = course.world.state
        recovery = recover_goals(rest, Revision(), limits, None, state.facts)
        if not isinstance(recovery.outcome, Found):
            return GivesUp(recovery.outcome.reason)
        for goal in recovery.given_up:
            course.recorder.note(RecordKind.GIVEN_UP, goal=goal.goal, why=goal.why)
        handler.scope = handler.scope.narrowed(recovery.problem, state, recovery.given_up)
        return FurtherPlan(
            compile_ready_plan(recovery.problem, recovery.outcome.plan, None, now, since=since), why
        )


def _diagnose_misfit(
    course: RunProgress, handler: ExceptionHandler, wrong: Sequence[str], why: str
) -> FurtherPlan | GivesUp:
    """Have it found out why the datums fit nowhere: by the fault base, about the last of those
    that disagree.
    """
    last = next(
        (e for e in reversed(course.values) if not wrong or e.of in wrong), course.values[-1]
    )
    handled = handler.handled(read_ground_atom(last.action), None, 0, DATUMS_MISFIT, None)
    if isinstance(handled, GivesUp):
        return GivesUp(f"{why}; {handled.why}", handled.stops)
    return FurtherPlan(handled, "recovery")


def _reopen_facts(course: RunProgress, names: Sequence[str], problem: Problem, why: str) -> None:
    """Take the measurements for not done in the world model."""
    gone = facts_of(problem, names, course.world.facts)
    if not gone:
        return
    facts = frozenset(course.world.facts) - set(gone)
    course.world.become(replace(course.world.state, facts=facts))
    course.recorder.note(
        RecordKind.WORLD,
        why=why,
        adds=[],
        ends=sorted(map(str, gone)),
        reached=dict(course.world.reached),
    )


def _repeat_text(repeat: Repeat) -> str:
    """What is measured again and why, in a line."""
    named = ", ".join(sorted(repeat.names)[:MAX_LISTED_NAMES]) + (
        ", ..." if len(repeat.names) > MAX_LISTED_NAMES else ""
    )
    return f"measured again: {repeat.what} ({named})" + (f"; {repeat.why}" if repeat.why else "")


def _reasons_text(names: Mapping[str, str]) -> str:
    return "; ".join(f"{name}: {why}" for name, why in sorted(names.items()))
