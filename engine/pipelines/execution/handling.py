"""The exception handler of a run: find the cause with tests, put it right, and plan on for the original goals (ITA)."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

from cellwright.engine.model.cases import Diagnosis, Revision
from cellwright.engine.model.execution import RecordKind
from cellwright.engine.model.outcome import Found, Infeasible
from cellwright.engine.model.troubleshooting import Action, Advice
from cellwright.engine.model.wording import counted
from cellwright.engine.pipelines.execution.commands import asking, command_of
from cellwright.engine.pipelines.execution.compiling import alone, unit_ms
from cellwright.engine.pipelines.execution.course import Course
from cellwright.engine.pipelines.execution.hands import Interruption, perform
from cellwright.engine.pipelines.execution.meeting import by_another_way, nobody_knows, rerouted, what_stopped
from cellwright.engine.pipelines.execution.planned import Ready, again, ready
from cellwright.engine.pipelines.execution.replies import exception_of, matched
from cellwright.engine.pipelines.execution.scope import Scope
from cellwright.engine.pipelines.execution.silence import TIMEOUT, cleared_up
from cellwright.engine.pipelines.revision.remaining import left_over
from cellwright.engine.pipelines.simulation import WorldState
from cellwright.engine.pipelines.troubleshooting import Desk, Opened, Recovery, opened
from cellwright.engine.pipelines.troubleshooting.findings import Findings
from cellwright.engine.pipelines.troubleshooting.given import Moment
from cellwright.engine.pipelines.troubleshooting.recovery import recover
from cellwright.engine.pipelines.verdicts.spoiling import spoils, spoilt_in
from cellwright.engine.stages.diagnosis.knowledge import CURED, NOT_CURED, Objective
from cellwright.engine.stages.diagnosis.session import QUESTION, run
from cellwright.engine.stages.execution import Failure
from cellwright.engine.stages.planning import Limits
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.model.faults import FaultModel
from cellwright.kb.model.plan import Plan, Step, StepId
from cellwright.kb.model.problem import Problem
from cellwright.kb.terms import Atom, Function

MOST = 3  # times that one step may fail in one way before it is not tried again
DEPTH = 4  # cases within cases
EXPANSIONS = 20_000  # of the search for the next test


@dataclass(frozen=True, slots=True)
class GivesUp:
    """There is no way on, and why. `stops` says that the cell is left in a safe stop for a person; else nothing is left to do."""

    why: str
    stops: bool = True


@dataclass
class ExceptionHandler:
    """Handles the exceptions of one run."""

    course: Course
    scope: Scope
    base: FaultModel | None
    limits: Limits = field(default_factory=Limits)
    cases: dict[tuple[str, str], int] = field(default_factory=dict)
    story: list[str] = field(default_factory=list)

    def handle(self, failures: Sequence[Failure]) -> Ready | GivesUp:
        """How the run goes on after failures. The first is looked into; the others show again if their causes are there."""
        failure = failures[0]
        step = self.course.replies.step(failure.activity)
        done = frozenset(StepId(each) for each in self.course.done)
        left = left_over(self.course.compiled.plan, done)
        return self.handled(step, failure.activity, failure.number, failure.reply, left)

    def handled(
        self, step: Function, activity: int | None, number: int, reply: str, left: Plan | None, depth: int = 0
    ) -> Ready | GivesUp:
        """How the run goes on after a step got a bad reply. `left` are the steps that were left of the plan."""
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
        if reply == TIMEOUT and activity is not None and left is not None:
            said = cleared_up(self.course, step, activity, number)
            if said:
                return self._goes_on_after_silence(said, exception or TIMEOUT, step, left)
        if by_another_way(self.course, reply):
            return self._by_another_way(step, reply, left)
        if "diagnosis" not in self.scope.problem.domain.tools:
            return GivesUp(f"{step} was answered '{reply}', and the domain's tools are without diagnosis")
        if self.base is None or exception is None:
            return GivesUp(f"{step} was answered '{reply}', and {nobody_knows(reply)}")
        seen = self._seen(exception, step)
        if seen > MOST or depth >= DEPTH:
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
    ) -> Ready | GivesUp:
        """Go on when it is known what became of a command that had no reply in its time."""
        self.story.append(said)
        if self._seen(exception, step) > MOST:
            return GivesUp(f"{said}, more than {MOST} times")
        rest = left_over(left, {StepId(each) for each in self.course.done})
        state = self.course.world.state
        found = recover(self.scope.rest(state), Revision(), self.limits, rest, state.facts)
        if not isinstance(found.outcome, Found):
            return GivesUp(found.outcome.reason)
        self.scope = self.scope.narrowed(found.problem, state, found.given_up)
        return self._from_now(found.problem, found.outcome.plan)

    def _by_another_way(self, step: Function, reply: str, left: Plan | None) -> Ready | GivesUp:
        """Plan anew with motion, from where the arm stands, in the cell as it is believed to be now."""
        if self._seen(reply, step) > MOST:
            return GivesUp(f"{step} is {reply} for the {MOST + 1}th time")
        state = self.course.world.state
        found = rerouted(self.course, self.scope.rest(state), left, self.limits)
        end = "there is no other way" if isinstance(found, str) else "planned anew"
        self.story.append(f"{step}: {what_stopped(self.course, reply)}; {end}")
        if isinstance(found, str):
            return GivesUp(found)
        self.scope = self.scope.narrowed(found.problem, state, found.given_up)
        if found.starts is not None:  # another order could bring arms together
            now_ms, since = self.course.driver.now_ms(), self.course.since
            return ready(found.problem, found.plan, found.starts, now_ms, since=since)
        return self._from_now(found.problem, found.plan)

    def _from_now(self, problem: Problem, plan: Plan) -> Ready:
        """The program of a plan from now on."""
        return again(problem, plan, self.course.driver.now_ms(), self.limits, self.course.since)

    def _case(self, exception: str, step: Function, left: Plan | None, depth: int) -> Ready | GivesUp:
        assert self.base is not None
        world = self.course.world.state
        moment = Moment(self.scope.problem, self.scope.rest(world), world, tuple(self.course.history), left)
        case = Opened(self.base, exception, step, Objective.REPAIR, expansions=EXPANSIONS)
        desk = opened(case, self.scope.problem.domain, moment)
        try:
            made = self._looked_into(desk)
            self._diagnosed(made, step)
            recovery = self._recovered(desk, made)
        except Interruption as other:
            _take(desk, other.taken)
            believed = Findings(desk.beliefs, desk.session.diagnosis()).believed if desk.beliefs else world
            self._believe(believed, f"while {exception} was looked into, {other.step} failed")
            self.story.append(f"{step}: {exception}; while it was looked into, {other.step} failed")
            return self.handled(other.step, None, other.number, other.reply, None, depth + 1)
        except InvalidInput as error:  # what was found contradicts what was believed
            told = error.diagnostics[0].message
            return GivesUp(f"{exception} at {step}: what is known of the cell now contradicts itself: {told}")
        return self._goes_on(exception, made, recovery, world)

    def _looked_into(self, desk: Desk) -> Diagnosis:
        """The end of a case. A test that cannot be prepared, or that nobody answers, is left out, and others are tried."""
        unable: list[str] = []

        def answer(action: Action, advice: Advice) -> str | None:
            said = self._answer(desk, action, advice)
            unable.extend([action.name] if said is None and action.name != QUESTION else [])
            return said

        while True:
            unable.clear()
            made = run(desk.session, answer)
            if not unable:
                return made
            desk.session.leave_out(unable[0])

    def _recovered(self, desk: Desk, made: Diagnosis) -> Recovery:
        """The recovery, after the repair with which it begins. One that does not help is not tried again."""
        while (first := (found := desk.recover(made, limits=self.limits)).repair) is not None:
            self._prepare(first.prepared.steps)
            if self._act(desk, first.name, (CURED, NOT_CURED)) == CURED:
                break
            assert desk.beliefs is not None
            desk.beliefs.carried_out(first.name, NOT_CURED, first.prepared)
            made = replace(made, repairs=tuple(each for each in made.repairs if each != first.name))
        return found

    def _goes_on(
        self, exception: str, made: Diagnosis, recovery: Recovery, before: WorldState
    ) -> Ready | GivesUp:
        assert self.base is not None
        now = recovery.now or before
        self._believe(now, _reason(exception, made))
        for goal in recovery.given_up:
            self.course.recorder.note(RecordKind.GIVEN_UP, goal=goal.goal, why=goal.why)
        outcome = recovery.outcome
        if not isinstance(outcome, Found):
            self.scope = replace(self.scope, given_up=(*self.scope.given_up, *recovery.given_up))
            causes = {cause for hypothesis, _ in made.hypotheses for cause in hypothesis.causes}
            stops = not isinstance(outcome, Infeasible) or any(
                self.base.causes[each].stops for each in causes
            )
            return GivesUp(outcome.reason, stops and not made.cured)
        found = self.scope if recovery.change is None else self.scope.changed(recovery.change)
        self.scope = found.narrowed(recovery.problem, now, recovery.given_up)
        self.course.world.chains = self.scope.problem.chains
        return self._from_now(recovery.problem, outcome.plan)

    def _believe(self, state: WorldState, why: str) -> None:
        new, gone = self.course.world.become(state)
        if new or gone:
            self.course.recorder.note(
                RecordKind.WORLD,
                why=why,
                adds=[str(each) for each in new],
                ends=[str(each) for each in gone],
                reached=dict(state.reached),
                **self._spoils(gone, why),
            )

    def _spoils(self, gone: Iterable[Atom], why: str) -> dict[str, list[list[str]]]:
        """The measurements among facts that a cause has ended: their values do not count any more."""
        said = spoils(gone, self.course.measured) if self.course.measured else []
        self.course.spoilt += spoilt_in([({"spoils": said, "why": why}, self.course.driver.now_ms())])
        return {"spoils": said} if said else {}

    def _diagnosed(self, made: Diagnosis, step: Function) -> None:
        likely = [str(hypothesis) for hypothesis, _ in made.hypotheses[:3]]
        cause = likely[0] if made.isolated and likely else f"not certain ({' or '.join(likely)})"
        ended = f"{made.cured} put it right" if made.cured else "nothing put it right"
        tests = f"{counted(len(made.stages), 'action')} of diagnosis"
        self.story.append(f"{step}: {made.exception}; {tests}; cause: {cause}; {ended}")
        self.course.recorder.note(
            RecordKind.DIAGNOSIS,
            exception=made.exception,
            causes=[[str(hypothesis), round(p, 4)] for hypothesis, p in made.hypotheses[:4]],
            cured=made.cured,
            isolated=made.isolated,
            cost=made.cost,
        )

    def _answer(self, desk: Desk, action: Action, advice: Advice) -> str | None:
        """What a test, a repair or a person answers, after what prepares it. Raises `Interruption` if a step fails."""
        session = desk.session
        prepared = session.prepared if action.name != QUESTION else None
        if prepared is not None and not self._is_prepared(desk, prepared.steps):
            return None
        outcome = self._act(desk, action.name, action.outcomes)
        if outcome is None and prepared is not None:
            _take(desk, [step.operator for step in prepared.steps])
        self.course.recorder.note(
            RecordKind.FINDING,
            exception=session.exception,
            action=action.name,
            outcome=outcome,
            belief=[[str(hypothesis), round(p, 4)] for hypothesis, p in session.belief()[:4]],
            expected_cost=round(advice.expected_cost, 3),
        )
        return outcome

    def _act(self, desk: Desk, name: str, outcomes: Sequence[str]) -> str | None:
        """The outcome of a test, a repair or a question; None if nobody answers as one should."""
        made = perform(self.course, asking(desk, name, outcomes, unit_ms(self.scope.problem.domain)))
        return made.reply if made.reply in outcomes else None

    def _is_prepared(self, desk: Desk, steps: Sequence[Step]) -> bool:
        """Whether the steps that prepare a test work. Raises `Interruption` if one fails in a way that the fault base knows."""
        try:
            self._prepare(steps)
        except Interruption as other:
            if exception_of(self.base, other.step, other.reply) is not None:
                raise
            _take(desk, other.taken)
            return False
        return True

    def _prepare(self, steps: Sequence[Step]) -> None:
        """Carry out the steps that prepare a test or a repair, one after another. Raises `Interruption`."""
        for number, step in enumerate(steps):
            activity, expected = alone(self.scope.problem.domain, step)
            made = perform(self.course, command_of(0, activity))
            if matched(expected, made.reply) is None:
                taken = tuple(each.operator for each in steps[:number])
                raise Interruption(step.operator, made.command.number, made.reply, taken)


def _reason(exception: str, made: Diagnosis) -> str:
    """Why the world is believed to be another: the cause where it is known, and the exception."""
    cause = str(made.hypotheses[0][0]) if made.isolated and made.hypotheses else ""
    return f"{cause} ({exception})" if cause else exception


def _take(desk: Desk, steps: Sequence[Function]) -> None:
    """Take in steps that were carried out for a test or a repair which came to nothing."""
    assert desk.beliefs is not None
    desk.beliefs.deeds.extend(steps)
