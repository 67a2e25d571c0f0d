"""Exception handler of a run: find the cause by tests, repair it, replan for the original goals."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

from cellwright.engine.model.noun_wording import count_noun
from cellwright.engine.model.outcome import Found, Infeasible
from cellwright.engine.model.run_protocol import RecordKind
from cellwright.engine.model.troubleshooting import Action, CaseAdvice, CaseDiagnosis, Revision
from cellwright.engine.pipelines.execution.compiled_program import activity_alone, unit_ms
from cellwright.engine.pipelines.execution.executable_plan import (
    ReadyPlan,
    compile_ready_plan,
    schedule_again,
)
from cellwright.engine.pipelines.execution.obstacles_met import (
    by_another_way,
    nobody_knows,
    reroute_run,
    what_stopped,
)
from cellwright.engine.pipelines.execution.run_goals import RunScope
from cellwright.engine.pipelines.execution.run_loop import RunLoop
from cellwright.engine.pipelines.execution.run_progress import (
    case_command,
    command_of,
    exception_of,
    match_reply,
)
from cellwright.engine.pipelines.execution.single_commands import (
    REPLY_TIMEOUT,
    CommandInterruption,
    cleared_up,
    perform_command,
)
from cellwright.engine.pipelines.inspection.spoilt_values import spoilt_in, spoilt_measurements
from cellwright.engine.pipelines.recovery import WorldState
from cellwright.engine.pipelines.recovery.case_findings import CaseFindings
from cellwright.engine.pipelines.recovery.case_input import ExceptionMoment
from cellwright.engine.pipelines.recovery.diagnosis_case import (
    CaseSettings,
    DiagnosisCase,
    RecoveryResult,
    case_from_settings,
)
from cellwright.engine.pipelines.recovery.remaining_problem import left_over
from cellwright.engine.pipelines.recovery.replanning import recover_goals
from cellwright.engine.stages.diagnosis.case_session import QUESTION, run_session
from cellwright.engine.stages.diagnosis.fault_problems import CURED, NOT_CURED, CaseObjective
from cellwright.engine.stages.execution import Failure
from cellwright.engine.stages.planning import SearchLimits
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.model.fault_model import FaultModel
from cellwright.kb.model.plan_model import Plan, Step, StepId
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Atom, Function

MAX_EXCEPTION_REPEATS = 3  # times that one step may fail in one way before it is not tried again
MAX_CASE_DEPTH = 4  # cases within cases
MAX_TEST_EXPANSIONS = 20_000  # of the search for the next test


@dataclass(frozen=True, slots=True)
class GivesUp:
    """There is no way on, and why.

    `stops` says that the cell is left in a safe stop for a person; else nothing is left to do.
    """

    why: str
    stops: bool = True


@dataclass
class ExceptionHandler:
    """Handles the exceptions of one run."""

    course: RunLoop
    scope: RunScope
    base: FaultModel | None
    limits: SearchLimits = field(default_factory=SearchLimits)
    cases: dict[tuple[str, str], int] = field(default_factory=dict)
    story: list[str] = field(default_factory=list)

    def handle(self, failures: Sequence[Failure]) -> ReadyPlan | GivesUp:
        """How the run goes on after failures.

        The first is looked into; the others show again if their causes are there.
        """
        failure = failures[0]
        step = self.course.replies.step(failure.activity)
        done = frozenset(StepId(number) for number in self.course.done)
        rest_plan = left_over(self.course.compiled.plan, done)
        return self.handled(step, failure.activity, failure.number, failure.reply, rest_plan)

    def handled(
        self,
        step: Function,
        activity: int | None,
        number: int,
        reply: str,
        left: Plan | None,
        depth: int = 0,
    ) -> ReadyPlan | GivesUp:
        """How the run goes on after a step got a bad reply.

        `left` are the steps that were left of the plan.
        """
        exception = exception_of(self.base, step, reply)
        self.course.recorder.note(
            RecordKind.EXCEPTION,
            exception=exception or reply,
            known=exception is not None or by_another_way(self.course, reply),
            step=activity,
            action=str(step),
            command=number,
            reply=reply,
        )
        if reply == REPLY_TIMEOUT and activity is not None and left is not None:
            explanation = cleared_up(self.course, step, activity, number)
            if explanation:
                return self._goes_on_after_silence(
                    explanation, exception or REPLY_TIMEOUT, step, left
                )
        if by_another_way(self.course, reply):
            return self._by_another_way(step, reply, left)
        if "diagnosis" not in self.scope.problem.domain.tools:
            return GivesUp(
                f"{step} was answered '{reply}', and the domain's tools are without diagnosis"
            )
        if self.base is None or exception is None:
            return GivesUp(f"{step} was answered '{reply}', and {nobody_knows(reply)}")
        seen = self._seen(exception, step)
        if seen > MAX_EXCEPTION_REPEATS or depth >= MAX_CASE_DEPTH:
            return GivesUp(
                f"{exception} at {step} for the {seen}th time: what was done about it did not help"
            )
        return self._case(exception, step, left, depth)

    def _seen(self, exception: str, step: Function) -> int:
        """How many times a step has failed in this way, with this time."""
        seen = self.cases[exception, str(step)] = self.cases.get((exception, str(step)), 0) + 1
        return seen

    def _goes_on_after_silence(
        self, said: str, exception: str, step: Function, left: Plan
    ) -> ReadyPlan | GivesUp:
        """Go on when it is known what became of a command that had no reply in its time."""
        self.story.append(said)
        if self._seen(exception, step) > MAX_EXCEPTION_REPEATS:
            return GivesUp(f"{said}, more than {MAX_EXCEPTION_REPEATS} times")
        rest = left_over(left, {StepId(number) for number in self.course.done})
        state = self.course.world.state
        recovery = recover_goals(self.scope.rest(state), Revision(), self.limits, rest, state.facts)
        if not isinstance(recovery.outcome, Found):
            return GivesUp(recovery.outcome.reason)
        self.scope = self.scope.narrowed(recovery.problem, state, recovery.given_up)
        return self._from_now(recovery.problem, recovery.outcome.plan)

    def _by_another_way(self, step: Function, reply: str, left: Plan | None) -> ReadyPlan | GivesUp:
        """Plan anew with motion, from where the arm stands, in the cell as it is believed to be
        now.
        """
        if self._seen(reply, step) > MAX_EXCEPTION_REPEATS:
            return GivesUp(f"{step} is {reply} for the {MAX_EXCEPTION_REPEATS + 1}th time")
        state = self.course.world.state
        rerouted_plan = reroute_run(self.course, self.scope.rest(state), left, self.limits)
        end = "there is no other way" if isinstance(rerouted_plan, str) else "planned anew"
        self.story.append(f"{step}: {what_stopped(self.course, reply)}; {end}")
        if isinstance(rerouted_plan, str):
            return GivesUp(rerouted_plan)
        self.scope = self.scope.narrowed(rerouted_plan.problem, state, rerouted_plan.given_up)
        if rerouted_plan.starts is not None:  # another order could bring arms together
            now_ms, since = self.course.driver.now_ms(), self.course.since
            return compile_ready_plan(
                rerouted_plan.problem, rerouted_plan.plan, rerouted_plan.starts, now_ms, since=since
            )
        return self._from_now(rerouted_plan.problem, rerouted_plan.plan)

    def _from_now(self, problem: Problem, plan: Plan) -> ReadyPlan:
        """The program of a plan from now on."""
        return schedule_again(
            problem, plan, self.course.driver.now_ms(), self.limits, self.course.since
        )

    def _case(
        self, exception: str, step: Function, left: Plan | None, depth: int
    ) -> ReadyPlan | GivesUp:
        assert self.base is not None
        world = self.course.world.state
        moment = ExceptionMoment(
            self.scope.problem, self.scope.rest(world), world, tuple(self.course.history), left
        )
        case = CaseSettings(
            self.base, exception, step, CaseObjective.REPAIR, expansions=MAX_TEST_EXPANSIONS
        )
        desk = case_from_settings(case, self.scope.problem.domain, moment)
        try:
            diagnosis = self._looked_into(desk)
            self._diagnosed(diagnosis, step)
            recovery = self._recovered(desk, diagnosis)
        except CommandInterruption as interruption:
            _take_steps(desk, interruption.taken)
            believed = (
                CaseFindings(desk.beliefs, desk.session.diagnosis()).believed
                if desk.beliefs
                else world
            )
            self._believe(
                believed, f"while {exception} was looked into, {interruption.step} failed"
            )
            self.story.append(
                f"{step}: {exception}; while it was looked into, {interruption.step} failed"
            )
            return self.handled(
                interruption.step, None, interruption.number, interruption.reply, None, depth + 1
            )
        except InvalidInput as error:  # what was found contradicts what was believed
            message = error.diagnostics[0].message
            return GivesUp(
                f"{exception} at {step}: what is known of the cell now contradicts itself: "
                f"{message}"
            )
        return self._goes_on(exception, diagnosis, recovery, world)

    def _looked_into(self, desk: DiagnosisCase) -> CaseDiagnosis:
        """The end of a case. A test that cannot be prepared, or that nobody answers, is left
        out, and others are tried.
        """
        unable: list[str] = []

        def answer(action: Action, advice: CaseAdvice) -> str | None:
            outcome = self._answer(desk, action, advice)
            unable.extend([action.name] if outcome is None and action.name != QUESTION else [])
            return outcome

        while True:
            unable.clear()
            diagnosis = run_session(desk.session, answer)
            if not unable:
                return diagnosis
            desk.session.leave_out(unable[0])

    def _recovered(self, desk: DiagnosisCase, made: CaseDiagnosis) -> RecoveryResult:
        """The recovery, after the repair with which it begins.

        One that does not help is not tried again.
        """
        while (first := (recovery := desk.recover(made, limits=self.limits)).repair) is not None:
            self._prepare(first.prepared.steps)
            if self._act(desk, first.name, (CURED, NOT_CURED)) == CURED:
                break
            assert desk.beliefs is not None
            desk.beliefs.carried_out(first.name, NOT_CURED, first.prepared)
            made = replace(
                made, repairs=tuple(repair for repair in made.repairs if repair != first.name)
            )
        return recovery

    def _goes_on(
        self, exception: str, made: CaseDiagnosis, recovery: RecoveryResult, before: WorldState
    ) -> ReadyPlan | GivesUp:
        assert self.base is not None
        now = recovery.now or before
        self._believe(now, _belief_reason(exception, made))
        for goal in recovery.given_up:
            self.course.recorder.note(RecordKind.GIVEN_UP, goal=goal.goal, why=goal.why)
        outcome = recovery.outcome
        if not isinstance(outcome, Found):
            self.scope = replace(self.scope, given_up=(*self.scope.given_up, *recovery.given_up))
            causes = {cause for hypothesis, _ in made.hypotheses for cause in hypothesis.causes}
            stops = not isinstance(outcome, Infeasible) or any(
                self.base.causes[cause].stops for cause in causes
            )
            return GivesUp(outcome.reason, stops and not made.cured)
        new_scope = self.scope if recovery.change is None else self.scope.changed(recovery.change)
        self.scope = new_scope.narrowed(recovery.problem, now, recovery.given_up)
        self.course.world.chains = self.scope.problem.chains
        return self._from_now(recovery.problem, outcome.plan)

    def _believe(self, state: WorldState, why: str) -> None:
        new, gone = self.course.world.become(state)
        if new or gone:
            self.course.recorder.note(
                RecordKind.WORLD,
                why=why,
                adds=[str(atom) for atom in new],
                ends=[str(atom) for atom in gone],
                reached=dict(state.reached),
                **self._spoils(gone, why),
            )

    def _spoils(self, gone: Iterable[Atom], why: str) -> dict[str, list[list[str]]]:
        """The measurements among facts that a cause has ended: their values do not count any
        more.
        """
        spoilt_names = (
            spoilt_measurements(gone, self.course.measured) if self.course.measured else []
        )
        self.course.spoilt += spoilt_in(
            [({"spoils": spoilt_names, "why": why}, self.course.driver.now_ms())]
        )
        return {"spoils": spoilt_names} if spoilt_names else {}

    def _diagnosed(self, made: CaseDiagnosis, step: Function) -> None:
        likely = [str(hypothesis) for hypothesis, _ in made.hypotheses[:3]]
        cause = likely[0] if made.isolated and likely else f"not certain ({' or '.join(likely)})"
        ended = f"{made.cured} put it right" if made.cured else "nothing put it right"
        tests = f"{count_noun(len(made.stages), 'action')} of diagnosis"
        self.story.append(f"{step}: {made.exception}; {tests}; cause: {cause}; {ended}")
        self.course.recorder.note(
            RecordKind.DIAGNOSIS,
            exception=made.exception,
            causes=[[str(hypothesis), round(p, 4)] for hypothesis, p in made.hypotheses[:4]],
            cured=made.cured,
            isolated=made.isolated,
            cost=made.cost,
        )

    def _answer(self, desk: DiagnosisCase, action: Action, advice: CaseAdvice) -> str | None:
        """What a test, a repair or a person answers, after what prepares it.

        Raises `Interruption` if a step fails.
        """
        session = desk.session
        prepared = session.prepared if action.name != QUESTION else None
        if prepared is not None and not self._is_prepared(desk, prepared.steps):
            return None
        outcome = self._act(desk, action.name, action.outcomes)
        if outcome is None and prepared is not None:
            _take_steps(desk, [step.operator for step in prepared.steps])
        self.course.recorder.note(
            RecordKind.FINDING,
            exception=session.exception,
            action=action.name,
            outcome=outcome,
            belief=[[str(hypothesis), round(p, 4)] for hypothesis, p in session.belief()[:4]],
            expected_cost=round(advice.expected_cost, 3),
        )
        return outcome

    def _act(self, desk: DiagnosisCase, name: str, outcomes: Sequence[str]) -> str | None:
        """The outcome of a test, a repair or a question; None if nobody answers as one should."""
        performed = perform_command(
            self.course, case_command(desk, name, outcomes, unit_ms(self.scope.problem.domain))
        )
        return performed.reply if performed.reply in outcomes else None

    def _is_prepared(self, desk: DiagnosisCase, steps: Sequence[Step]) -> bool:
        """Whether the steps that prepare a test work.

        Raises `Interruption` if one fails in a way that the fault base knows.
        """
        try:
            self._prepare(steps)
        except CommandInterruption as interruption:
            if exception_of(self.base, interruption.step, interruption.reply) is not None:
                raise
            _take_steps(desk, interruption.taken)
            return False
        return True

    def _prepare(self, steps: Sequence[Step]) -> None:
        """Carry out the steps that prepare a test or a repair, one after another.

        Raises `Interruption`.
        """
        for number, step in enumerate(steps):
            activity, expected = activity_alone(self.scope.problem.domain, step)
            performed = perform_command(self.course, command_of(0, activity))
            if match_reply(expected, performed.reply) is None:
                taken = tuple(step.operator for step in steps[:number])
                raise CommandInterruption(
                    step.operator, performed.command.number, performed.reply, taken
                )


def _belief_reason(exception: str, diagnosis: CaseDiagnosis) -> str:
    """Why the world is believed to be another: the cause where it is known, and the exception."""
    cause = str(diagnosis.hypotheses[0][0]) if diagnosis.isolated and diagnosis.hypotheses else ""
    return f"{cause} ({exception})" if cause else exception


def _take_steps(desk: DiagnosisCase, steps: Sequence[Function]) -> None:
    """Take in steps that were carried out for a test or a repair which came to nothing."""
    assert desk.beliefs is not None
    desk.beliefs.deeds.extend(steps)
