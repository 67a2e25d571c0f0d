"""The inspector of a run: what an inspection does at the end of a plan, noted in the journal so that a resumed run goes on with it."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from cellwright.engine.model.cases import Revision
from cellwright.engine.model.execution import RecordKind
from cellwright.engine.model.fits import Alignment
from cellwright.engine.model.outcome import Found
from cellwright.engine.model.wording import counted
from cellwright.engine.pipelines.execution.handling import ExceptionHandler, GivesUp
from cellwright.engine.pipelines.execution.inspecting import (
    Looks,
    datums_asked,
    facts_of,
    first_stage,
    judged,
    located,
    looks_needed,
    moved,
    reopened,
)
from cellwright.engine.pipelines.execution.planned import Ready, ready
from cellwright.engine.pipelines.execution.progress import Progress
from cellwright.engine.pipelines.execution.records import read_atom
from cellwright.engine.pipelines.execution.repeating import Repeat, repeats
from cellwright.engine.pipelines.execution.scope import Scope
from cellwright.engine.pipelines.execution.toplevel import made
from cellwright.engine.pipelines.troubleshooting.recovery import recover
from cellwright.engine.pipelines.verdicts.lying import Lying, lying_of
from cellwright.engine.pipelines.verdicts.spoiling import standing
from cellwright.engine.stages.planning import Limits
from cellwright.kb.model.problem import Problem
from cellwright.kb.model.results import Measured
from cellwright.kb.store.journal import Line

ALIGNED, AGAIN = "aligned", "again"  # reasons for another plan
MISFIT = "not_aligned"  # the reply that the fault base knows for datums that fit nowhere
ROUNDS = 6  # of repeated measurements
SHOWN = 8  # names in a line


@dataclass(frozen=True, slots=True)
class Further:
    """Another plan, and why it is followed."""

    ready: Ready
    why: str


def datums_first(found: Ready, scope: Scope) -> tuple[Ready, Scope]:
    """A plan that ends with the datums of the part, if it has such; else the whole plan. What comes behind is planned when they are measured."""
    stage = first_stage(found, scope)
    if stage is None:
        return found, scope
    plan, narrow = stage
    starts = {step.id: found.starts[step.id] for step in plan.steps}
    return replace(ready(scope.problem, plan, starts, 0), notes=found.notes), narrow


def measured_in(lines: Iterable[Line]) -> list[Measured]:
    """The values that the results in a journal hold."""
    return [_measured(line) for line in lines if line.content.get("of") is not None]


def _measured(line: Line) -> Measured:
    said = line.content
    numbers = (said["nominal"], said["lower"], said["upper"], said["tool"], said["action"], line.at_ms)
    sure = (said.get("uncertainty"), said.get("risk"))
    return Measured(said["of"], said["quantity"], said["value"], said["unit"], *numbers, *sure)


def there(whole: Problem, scope: Scope, content: Mapping[str, Any]) -> Scope:
    """The scope for all of a problem with its part where a record says, without what is lost or was given up."""
    found = Scope(moved(whole, lying_of(content, content["at_ms"])), scope.given_up)
    return found.changed(Revision(lost=scope.lost, blocked=tuple((each, "") for each in scope.blocked)))


@dataclass
class Inspector:
    """Follows one inspection. `entry` is the record that says where the part lies; empty as long as that is not known."""

    entry: dict[str, Any] = field(default_factory=dict)
    rounds: int = 0
    told: str = ""

    def taken_up(self, entry: Mapping[str, Any], course: Progress) -> None:
        """Go on where the part lies as a record of the run says."""
        self.entry = dict(entry)
        course.part = tuple(entry.get("part", ()))

    def _lying(self) -> Lying | None:
        return lying_of(self.entry, self.entry["at_ms"]) if self.entry else None

    def onward(
        self, problem: Problem, course: Progress, handler: ExceptionHandler, limits: Limits
    ) -> Further | GivesUp | None:
        """What an inspection goes on with at the end of a plan; None if it is over. The scope of the handler is set to it."""
        if not any(each.uncertainty for each in course.values):
            return None
        if not self.entry and datums_asked(problem):
            return self._aligned(problem, course, handler, limits)
        return self._again(problem, course, handler, limits)

    def _aligned(
        self, problem: Problem, course: Progress, handler: ExceptionHandler, limits: Limits
    ) -> Further | GivesUp:
        names, found = located(problem, standing(course.values, course.spoilt))
        if not isinstance(found, Alignment):
            course.recorder.note(RecordKind.ALIGNMENT, part=[], wrong=list(found.off), why=found.reason)
            return _misfit(course, handler, found.off, found.reason)
        looks = looks_needed(problem, standing(course.values, course.spoilt), found)
        if looks is not None:
            return self._looked_at_again(looks, problem, course, handler, limits)
        content = {
            "part": [float(each) for each in found.T_measured_nominal[:3].ravel()],
            "centre": found.centre.tolist(),
            "covariance": found.covariance.tolist(),
            "datums": int(found.used.sum()),
            "wrong": [name for name, used in zip(names, found.used, strict=True) if not used],
        }
        record = course.recorder.note(RecordKind.ALIGNMENT, **content)
        self.taken_up({**content, "at_ms": record.at_ms}, course)
        handler.scope = there(problem, handler.scope, self.entry)
        wrong: Sequence[str] = list(map(str, self.entry["wrong"]))
        _reopen(course, wrong, problem, "these datums disagree with the others")
        return self._planned(course, handler, handler.scope.rest(course.world.state), limits, ALIGNED)

    def _looked_at_again(
        self, looks: Looks, problem: Problem, course: Progress, handler: ExceptionHandler, limits: Limits
    ) -> Further | GivesUp:
        """Measure datums once more, because the part is not known as well as it has to be; or give up if that would not help."""
        if looks.refused:
            course.recorder.note(RecordKind.ALIGNMENT, part=[], wrong=[], why=looks.refused)
            return GivesUp(looks.refused, stops=False)
        names = {name: {"why": looks.told, "tool": ""} for name in looks.names}
        what = f"measured again: {counted(len(names), 'datum')}"
        course.recorder.note(RecordKind.DECISION, what=what, why=looks.told, again=names)
        handler.story.append(f"{what}; {looks.told}")
        rest, facts = handler.scope.rest(course.world.state), course.world.facts
        again = reopened(rest, dict.fromkeys(names, ""), facts)
        _reopen(course, list(names), problem, "they are measured again")
        return self._planned(course, handler, again, limits, AGAIN)

    def _again(
        self, problem: Problem, course: Progress, handler: ExceptionHandler, limits: Limits
    ) -> Further | None:
        if self.rounds >= ROUNDS:
            return None
        features = judged(problem, course.values, self._lying(), course.spoilt)
        rest, facts = handler.scope.rest(course.world.state), course.world.facts
        found = repeats(problem, features, rest, limits, facts)
        if found is None:
            return None
        if found.left and found.left != self.told:
            course.recorder.note(RecordKind.DECISION, what="some features stay undecided", why=found.left)
            self.told = found.left
        if not found.names:
            return None
        self.rounds += 1
        tools = {name: found.tools.get(name, "") for name in found.names}
        again = reopened(rest, tools, facts)
        _reopen(course, list(found.names), problem, "they are measured again")
        names = {name: {"why": why, "tool": tools[name]} for name, why in found.names.items()}
        told = "; ".join(each for each in (found.why, _reasons(found.names)) if each)
        course.recorder.note(RecordKind.DECISION, what=f"measured again: {found.what}", why=told, again=names)
        handler.story.append(_story(found))
        made_ = self._planned(course, handler, again, limits, AGAIN)
        return made_ if isinstance(made_, Further) else None

    def _planned(
        self, course: Progress, handler: ExceptionHandler, rest: Problem, limits: Limits, why: str
    ) -> Further | GivesUp:
        """The plan for what is left. What cannot be reached is given up."""
        now, since = course.driver.now_ms(), course.since
        found = made(rest, limits, "")
        if isinstance(found.outcome, Found):
            return Further(ready(rest, found.outcome.plan, found.starts, now, since=since), why)
        state = course.world.state
        other = recover(rest, Revision(), limits, None, state.facts)
        if not isinstance(other.outcome, Found):
            return GivesUp(other.outcome.reason)
        for goal in other.given_up:
            course.recorder.note(RecordKind.GIVEN_UP, goal=goal.goal, why=goal.why)
        handler.scope = handler.scope.narrowed(other.problem, state, other.given_up)
        return Further(ready(other.problem, other.outcome.plan, None, now, since=since), why)


def _misfit(course: Progress, handler: ExceptionHandler, wrong: Sequence[str], why: str) -> Further | GivesUp:
    """Have it found out why the datums fit nowhere: by the fault base, about the last of those that disagree."""
    last = next((e for e in reversed(course.values) if not wrong or e.of in wrong), course.values[-1])
    found = handler.handled(read_atom(last.action), None, 0, MISFIT, None)
    if isinstance(found, GivesUp):
        return GivesUp(f"{why}; {found.why}", found.stops)
    return Further(found, "recovery")


def _reopen(course: Progress, names: Sequence[str], problem: Problem, why: str) -> None:
    """Take the measurements for not done in the world model."""
    gone = facts_of(problem, names, course.world.facts)
    if not gone:
        return
    facts = frozenset(course.world.facts) - set(gone)
    course.world.become(replace(course.world.state, facts=facts))
    course.recorder.note(
        RecordKind.WORLD, why=why, adds=[], ends=sorted(map(str, gone)), reached=dict(course.world.reached)
    )


def _story(found: Repeat) -> str:
    """What is measured again and why, in a line."""
    named = ", ".join(sorted(found.names)[:SHOWN]) + (", ..." if len(found.names) > SHOWN else "")
    return f"measured again: {found.what} ({named})" + (f"; {found.why}" if found.why else "")


def _reasons(names: Mapping[str, str]) -> str:
    return "; ".join(f"{name}: {why}" for name, why in sorted(names.items()))
