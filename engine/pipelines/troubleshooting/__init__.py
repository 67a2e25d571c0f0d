"""Diagnosis with planning: plans give the set-up costs of tests, and the planner continues after the diagnosis.

The exception handler asks two kinds of questions: "what does it take to do this test now?" and "how does the work go on?".
Here the planner answers them.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from cellwright.engine.kernels.cancellation import Interrupted, never
from cellwright.engine.model.cases import Diagnosis, Revision
from cellwright.engine.pipelines import planning
from cellwright.engine.pipelines.barring import barred
from cellwright.engine.pipelines.revision.remaining import remaining
from cellwright.engine.pipelines.simulation import Dynamics, FaultyCell
from cellwright.engine.pipelines.troubleshooting.beliefs import Beliefs
from cellwright.engine.pipelines.troubleshooting.findings import Findings, first_repair
from cellwright.engine.pipelines.troubleshooting.given import (
    Failed,
    Moment,
    Seen,
    moment_of,
    numbered,
    read_step,
)
from cellwright.engine.pipelines.troubleshooting.preparations import WORK, Preparations, after
from cellwright.engine.pipelines.troubleshooting.recovery import Recovery, recover, told
from cellwright.engine.stages.diagnosis.knowledge import Objective, no_setup
from cellwright.engine.stages.diagnosis.revision import (
    Binding,
    binding_of,
    certainties,
    presupposed,
    revision,
)
from cellwright.engine.stages.diagnosis.session import Session
from cellwright.engine.stages.planning import Limits
from cellwright.kb.check.faults import too_many
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source, unknown_name
from cellwright.kb.loader import find
from cellwright.kb.loader.faults import load_faults
from cellwright.kb.model.domain import Domain
from cellwright.kb.model.faults import FaultModel
from cellwright.kb.store.cases import Cases, ClosedCase, counts
from cellwright.kb.terms import Atom, Function

__all__ = ["Desk", "Opened", "Preparations", "Recovery", "after", "desk", "fault_model", "opened", "recover"]


@dataclass
class Desk:
    """One case with everything around it: the fault base, the problem it happened in, and what the step binds.

    `moment` is when the exception was noticed, and `beliefs` what the world is believed to be since; None without a problem.
    """

    model: FaultModel
    session: Session
    binding: Binding
    domain: Domain
    moment: Moment | None = None
    beliefs: Beliefs | None = None

    def says(self, name: str) -> str:
        """The wording of a test or a repair for people; empty if it has none."""
        found = self.model.tests.get(name) or self.model.repairs.get(name)
        return found.say if found else ""

    def certainties(self, made: Diagnosis) -> dict[Atom, float]:
        """How certain the assertions are that some cause puts in doubt, among those that the step began with."""
        found = certainties(self.model, made.hypotheses, self.binding)
        known = self._known()
        return {atom: value for atom, value in found.items() if atom in known}

    def revision(self, made: Diagnosis) -> Revision:
        """What the case changes in the world model."""
        if self.beliefs is not None:
            return self._revised(self.beliefs, made)
        repaired = made.cured if made.cured in self.model.repairs else None
        said, known = revision(self.model, made, self.binding, repaired), self._known()
        return replace(said, restored=tuple((atom, why) for atom, why in said.restored if atom in known))

    def recover(self, made: Diagnosis, store: str = "", limits: Limits = Limits()) -> Recovery:
        """Plan on; a kept sequence of the problem is told what was lost. Raises `InvalidInput` without a problem.

        Where a cause is there still that hinders the plan, a sure repair that needs nobody comes first, if there is one.
        """
        if self.moment is None or self.beliefs is None:
            hint = "give a problem as the target: its goals are planned for"
            raise InvalidInput([Diagnostic(Source("--recover"), "K404", "a domain has no goals", hint)])
        limits = replace(limits, interrupted=self.session.interrupted)
        repaired = first_repair(self.beliefs, self.session, made)
        first, beliefs, ended = repaired or (None, self.beliefs, made)
        change, now = self._revised(beliefs, ended), Findings(beliefs, ended).believed
        moment = self.moment
        same = now.reached == moment.before.reached
        problem = moment.rest if same else remaining(moment.problem, now.reached, now.facts)
        found = recover(problem, change, limits, moment.left, now.facts, executable=same)
        found = told(found, problem, change.lost, store) if store else found
        return replace(found, repair=first, now=now, change=change)

    def _revised(self, beliefs: Beliefs, made: Diagnosis) -> Revision:
        repaired = made.cured if made.cured in self.model.repairs else None
        said = revision(self.model, made, self.binding, repaired)
        found = Findings(beliefs, made).applied(said)
        if self.moment is None:
            return found
        return replace(found, assumed=self.moment.assumed, follows=(*self.moment.follows, *found.follows))

    def _known(self) -> frozenset[Atom]:
        """What held when the interrupted step began."""
        if self.moment is not None:
            return self.moment.before.facts
        return frozenset(presupposed(self.domain, self.model, self.session.exception, self.binding))

    def keep(self, made: Diagnosis, store: str) -> None:
        """Store the case as closed if its cause is known."""
        causes = made.hypotheses[0][0].causes if made.isolated and made.hypotheses else ()
        if causes:
            seen = tuple((each.action, each.outcome) for each in made.observations)
            with Cases(store) as cases:
                cases.add([ClosedCase(self.model.domain, made.exception, causes, made.cost, seen)])


def desk(
    target: str,
    exception: str,
    step: str = "",
    objective: str = "isolate",
    store: str = "",
    expansions: int | None = None,
    interrupted: Interrupted = never,
    failed: Failed | None = None,
    seen: Seen = Seen(),
) -> Desk:
    """Open a case. Raises `InvalidInput`.

    With the plan that failed, set-up and recovery begin where it was interrupted, and `step` may be a number of the plan.
    `seen` corrects the state then.
    """
    loaded = planning.loaded(find(target))
    model, _ = load_faults(Path(loaded.domain.path))
    if exception not in model.exceptions:
        raise InvalidInput([unknown_name("exception", exception, model.exceptions, Source("--exception"))])
    if wrong := list(too_many(model.exceptions[exception])):
        raise InvalidInput(wrong)
    if failed is not None and step.isdecimal():
        failed, step = numbered(replace(failed, step=step))
    taken = read_step(step, loaded, model.exceptions[exception])
    moment = moment_of(loaded, taken, failed, seen)
    counted = model.exceptions[exception].counts
    if store:
        with Cases(store) as cases:
            counted = counts(counted, cases.history(model.domain, exception))
    case = Opened(model, exception, taken, Objective(objective), counted, expansions, interrupted)
    return opened(case, loaded.domain, moment)


@dataclass(frozen=True, slots=True)
class Opened:
    """A case as it is opened: what happened to which step, and how the search for its cause is limited."""

    model: FaultModel
    exception: str
    step: Function | None = None
    objective: Objective = Objective.ISOLATE
    counts: Mapping[str, float] | None = None
    expansions: int | None = None
    interrupted: Interrupted = never
    setup: bool = True  # tests are chosen by what it costs to prepare them, too


def opened(case: Opened, domain: Domain, moment: Moment | None) -> Desk:
    """The desk of a case; with a moment, tests and repairs are carried out in its world."""
    binding = binding_of(case.model, case.exception, case.step)
    beliefs = _beliefs(moment, case, binding) if moment else None
    session = Session(
        case.model,
        case.exception,
        case.objective,
        case.counts,
        beliefs.preparations if beliefs and case.setup else no_setup,
        case.expansions,
        case.interrupted,
        beliefs,
    )
    return Desk(case.model, session, binding, domain, moment, beliefs)


def _beliefs(moment: Moment, case: Opened, binding: Binding) -> Beliefs:
    """The beliefs at the beginning. No preparation takes the step that has just failed."""
    cell = FaultyCell(Dynamics(moment.problem), case.model, case.exception, binding, case.step, moment.done)
    others = barred(moment.rest, blocked=[case.step] if case.step else [])
    return Beliefs(
        cell, moment.before, Preparations(others, binding, replace(WORK, interrupted=case.interrupted))
    )


def fault_model(target: str) -> FaultModel:
    """The fault base of a target. Raises `InvalidInput`."""
    return load_faults(Path(planning.loaded(find(target)).domain.path))[0]
