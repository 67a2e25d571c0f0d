"""Case of diagnosis: fault base, tests priced by plans, and how work goes on afterwards.

The exception handler asks two kinds of questions: "what does it take to do this test now?" and "how
does the work go on?". Here the planner answers them.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from cellwright.engine.kernels.cancellation import Interrupted, never
from cellwright.engine.model.troubleshooting import CaseDiagnosis, Revision
from cellwright.engine.pipelines.planning import checked_plan
from cellwright.engine.pipelines.planning.restrictions import forbid_steps
from cellwright.engine.pipelines.recovery import Dynamics, FaultyCell
from cellwright.engine.pipelines.recovery.case_beliefs import (
    PREPARATION_LIMITS,
    CaseBeliefs,
    Preparations,
    state_after,
)
from cellwright.engine.pipelines.recovery.case_findings import CaseFindings, first_repair
from cellwright.engine.pipelines.recovery.case_input import (
    ExceptionMoment,
    FailedPlan,
    ObservedFacts,
    loaded_moment,
    number_steps,
    read_step,
)
from cellwright.engine.pipelines.recovery.remaining_problem import remaining_problem
from cellwright.engine.pipelines.recovery.replanning import (
    RecoveryResult,
    recover_goals,
    with_kept_sequence,
)
from cellwright.engine.stages.diagnosis.belief_revision import (
    Binding,
    assertion_certainties,
    binding_of,
    presupposed_facts,
    world_revision,
)
from cellwright.engine.stages.diagnosis.case_session import CaseSession
from cellwright.engine.stages.diagnosis.fault_problems import CaseObjective, no_setup
from cellwright.engine.stages.planning import SearchLimits
from cellwright.kb.check.fault_base_check import too_many_causes
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source, unknown_name
from cellwright.kb.loader import find_target
from cellwright.kb.loader.fault_base import load_faults
from cellwright.kb.model.domain_model import Domain
from cellwright.kb.model.fault_model import FaultModel
from cellwright.kb.store.case_store import Cases, ClosedCase, cause_counts
from cellwright.kb.terms import Atom, Function

__all__ = [
    "CaseSettings",
    "DiagnosisCase",
    "Preparations",
    "RecoveryResult",
    "case_from_settings",
    "fault_model",
    "open_diagnosis_case",
    "recover_goals",
    "state_after",
]


@dataclass
class DiagnosisCase:
    """One case with everything around it: the fault base, the problem it happened in, and what the
    step binds.

    `moment` is when the exception was noticed, and `beliefs` what the world is believed to be
    since; None without a problem.
    """

    model: FaultModel
    session: CaseSession
    binding: Binding
    domain: Domain
    moment: ExceptionMoment | None = None
    beliefs: CaseBeliefs | None = None

    def says(self, name: str) -> str:
        """The wording of a test or a repair for people; empty if it has none."""
        action_model = self.model.tests.get(name) or self.model.repairs.get(name)
        return action_model.say if action_model else ""

    def certainties(self, diagnosis: CaseDiagnosis) -> dict[Atom, float]:
        """How certain the assertions are that some cause puts in doubt, among those that the
        step began with.
        """
        certainty_of = assertion_certainties(self.model, diagnosis.hypotheses, self.binding)
        known_atoms = self._known()
        return {atom: value for atom, value in certainty_of.items() if atom in known_atoms}

    def revision(self, diagnosis: CaseDiagnosis) -> Revision:
        """What the case changes in the world model."""
        if self.beliefs is not None:
            return self._revised(self.beliefs, diagnosis)
        repaired = diagnosis.cured if diagnosis.cured in self.model.repairs else None
        reasoned, known_atoms = (
            world_revision(self.model, diagnosis, self.binding, repaired),
            self._known(),
        )
        return replace(
            reasoned,
            restored=tuple((atom, why) for atom, why in reasoned.restored if atom in known_atoms),
        )

    def recover(
        self, made: CaseDiagnosis, store: str = "", limits: SearchLimits = SearchLimits()
    ) -> RecoveryResult:
        """Plan on; a kept sequence of the problem is told what was lost. Raises `InvalidInput`
        without a problem.

        Where a cause is there still that hinders the plan, a sure repair that needs nobody comes
        first, if there is one.
        """
        if self.moment is None or self.beliefs is None:
            hint = "give a problem as the target: its goals are planned for"
            raise InvalidInput(
                [Diagnostic(Source("--recover"), "K404", "a domain has no goals", hint)]
            )
        limits = replace(limits, interrupted=self.session.interrupted)
        repaired = first_repair(self.beliefs, self.session, made)
        first, beliefs, ended = repaired or (None, self.beliefs, made)
        change, now = self._revised(beliefs, ended), CaseFindings(beliefs, ended).believed
        moment = self.moment
        same = now.reached == moment.before.reached
        problem = moment.rest if same else remaining_problem(moment.problem, now.reached, now.facts)
        recovery = recover_goals(problem, change, limits, moment.left, now.facts, executable=same)
        recovery = with_kept_sequence(recovery, problem, change, store) if store else recovery
        return replace(recovery, repair=first, now=now, change=change)

    def revision_after(self, made: CaseDiagnosis, recovery: RecoveryResult | None) -> Revision:
        """What the case changes in the world model, after the repair with which a recovery
        begins if there is one.
        """
        if recovery is None or recovery.repair is None or recovery.change is None:
            return self.revision(made)
        return recovery.change

    def _revised(self, beliefs: CaseBeliefs, made: CaseDiagnosis) -> Revision:
        repaired = made.cured if made.cured in self.model.repairs else None
        reasoned = world_revision(self.model, made, self.binding, repaired)
        applied = CaseFindings(beliefs, made).applied(reasoned)
        if self.moment is None:
            return applied
        return replace(
            applied, assumed=self.moment.assumed, follows=(*self.moment.follows, *applied.follows)
        )

    def _known(self) -> frozenset[Atom]:
        """What held when the interrupted step began."""
        if self.moment is not None:
            return self.moment.before.facts
        return frozenset(
            presupposed_facts(self.domain, self.model, self.session.exception, self.binding)
        )

    def keep(self, made: CaseDiagnosis, store: str) -> None:
        """Store the case as closed if its cause is known."""
        causes = made.hypotheses[0][0].causes if made.isolated and made.hypotheses else ()
        if causes:
            seen = tuple(
                (observation.action, observation.outcome) for observation in made.observations
            )
            with Cases(store) as cases:
                cases.add([ClosedCase(self.model.domain, made.exception, causes, made.cost, seen)])


def open_diagnosis_case(
    target: str,
    exception: str,
    step: str = "",
    objective: str | None = None,
    store: str = "",
    expansions: int | None = None,
    interrupted: Interrupted = never,
    failed: FailedPlan | None = None,
    seen: ObservedFacts = ObservedFacts(),
    certainty: float | None = None,
) -> DiagnosisCase:
    """Open a case. Raises `InvalidInput`.

    With the plan that failed, set-up and recovery begin where it was interrupted, and `step` may be
    a number of the plan. `seen` corrects the state then. Without an `objective` it is the one that
    suits the tests, and so is the `certainty` with which a cause counts as found.
    """
    loaded = checked_plan.load_target(find_target(target))
    model, _ = load_faults(Path(loaded.domain.path))
    if exception not in model.exceptions:
        raise InvalidInput(
            [unknown_name("exception", exception, model.exceptions, Source("--exception"))]
        )
    if wrong := list(too_many_causes(model.exceptions[exception])):
        raise InvalidInput(wrong)
    if failed is not None and step.isdecimal():
        failed, step = number_steps(replace(failed, step=step))
    taken = read_step(step, loaded, model.exceptions[exception])
    moment = loaded_moment(loaded, taken, failed, seen)
    counted = model.exceptions[exception].counts
    if store:
        with Cases(store) as cases:
            counted = cause_counts(counted, cases.history(model.domain, exception))
    aim = CaseObjective(objective) if objective else None
    case = CaseSettings(
        model, exception, taken, aim, counted, expansions, interrupted, certainty=certainty
    )
    return case_from_settings(case, loaded.domain, moment)


@dataclass(frozen=True, slots=True)
class CaseSettings:
    """A case as it is opened: what happened to which step, and how the search for its cause is
    limited.
    """

    model: FaultModel
    exception: str
    step: Function | None = None
    objective: CaseObjective | None = None  # None: the one that suits the tests
    counts: Mapping[str, float] | None = None
    expansions: int | None = None
    interrupted: Interrupted = never
    setup: bool = True  # tests are chosen by what it costs to prepare them, too
    certainty: float | None = None  # with which a cause counts as found; None: what suits the tests


def case_from_settings(
    case: CaseSettings, domain: Domain, moment: ExceptionMoment | None
) -> DiagnosisCase:
    """The desk of a case; with a moment, tests and repairs are carried out in its world."""
    binding = binding_of(case.model, case.exception, case.step)
    beliefs = _initial_beliefs(moment, case, binding) if moment else None
    session = CaseSession(
        case.model,
        case.exception,
        case.objective,
        case.counts,
        beliefs.preparations if beliefs and case.setup else no_setup,
        case.expansions,
        case.interrupted,
        beliefs,
        case.certainty,
    )
    return DiagnosisCase(case.model, session, binding, domain, moment, beliefs)


def _initial_beliefs(moment: ExceptionMoment, case: CaseSettings, binding: Binding) -> CaseBeliefs:
    """The beliefs at the beginning. No preparation takes the step that has just failed."""
    cell = FaultyCell(
        Dynamics(moment.problem), case.model, case.exception, binding, case.step, moment.done
    )
    other_steps = forbid_steps(moment.rest, blocked=[case.step] if case.step else [])
    return CaseBeliefs(
        cell,
        moment.before,
        Preparations(
            other_steps, binding, replace(PREPARATION_LIMITS, interrupted=case.interrupted)
        ),
    )


def fault_model(target: str) -> FaultModel:
    """The fault base of a target. Raises `InvalidInput`."""
    return load_faults(Path(checked_plan.load_target(find_target(target)).domain.path))[0]
