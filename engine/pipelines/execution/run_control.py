"""A whole run: plan, execute, handle exceptions and replan until nothing more can be done."""

from contextlib import suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from cellwright.engine.model.run_protocol import Finish, OperatorCommand, RecordKind, RunPhase
from cellwright.engine.pipelines.execution.cell_rest import TOLD_TO_END, CellRest
from cellwright.engine.pipelines.execution.checkpoints import remaining_pages, state_of
from cellwright.engine.pipelines.execution.coming_to_rest import come_to_rest
from cellwright.engine.pipelines.execution.compiled_program import (
    CompiledProgram,
    full_hands,
    with_queues,
)
from cellwright.engine.pipelines.execution.exception_handler import ExceptionHandler, GivesUp
from cellwright.engine.pipelines.execution.executable_plan import ReadyPlan
from cellwright.engine.pipelines.execution.inspector import ALIGNED, Inspector
from cellwright.engine.pipelines.execution.obstacles_met import stand_again
from cellwright.engine.pipelines.execution.operator_changes import (
    RESUME_ORIGIN,
    OrderRefused,
    change_run,
)
from cellwright.engine.pipelines.execution.operator_orders import GivenOrder, OrderSource
from cellwright.engine.pipelines.execution.plan_records import (
    end_entry,
    plan_content,
    read_ground_atom,
    standing_entry,
)
from cellwright.engine.pipelines.execution.plan_review import choose_exchange, review_plan
from cellwright.engine.pipelines.execution.run_goals import (
    RunScope,
    extend_problem,
    read_addition,
    wished_times,
)
from cellwright.engine.pipelines.execution.run_journal import Recorder
from cellwright.engine.pipelines.execution.run_loop import RunLoop, is_approved
from cellwright.engine.pipelines.execution.run_progress import (
    RECORDS_PER_CHECKPOINT,
    Checkpoint,
    LoopTurn,
)
from cellwright.engine.pipelines.execution.run_resumption import (
    PastRun,
    left_out,
    restore_loop,
    settle_commands,
    taken_up,
)
from cellwright.engine.pipelines.execution.single_commands import RunEnded
from cellwright.engine.pipelines.inspection.nominal_values import MeasurementJudge
from cellwright.engine.pipelines.planning.plan_gate import InternalError
from cellwright.engine.pipelines.recovery import KeptHistory, SymbolicWorld
from cellwright.engine.pipelines.recovery.remaining_problem import left_over
from cellwright.engine.ports import Driver
from cellwright.engine.stages.execution import ExecutiveState, standing_of
from cellwright.engine.stages.planning import SearchLimits
from cellwright.kb import stopping
from cellwright.kb.model.fault_model import FaultModel
from cellwright.kb.model.plan_model import StepId
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.stopping import StoppedByCaller
from cellwright.kb.store.journal import JournalFailure

if TYPE_CHECKING:
    from cellwright.engine.pipelines.execution.run_motions import RunPaths

MAX_WHY_CHARACTERS = 200  # of what a journal tells of an error
REACHED, PARTLY, STOPPED, ABORTED, PAUSED = "reached", "partly", "stopped", "aborted", "paused"


@dataclass
class RunExecution:
    """One run. `problem` is as it was given; `scope` is what is still pursued of it."""

    run: str
    problem: Problem
    driver: Driver
    recorder: Recorder
    orders: OrderSource
    base: FaultModel | None = None
    limits: SearchLimits = field(default_factory=SearchLimits)
    steps: int = 0
    exceptions: int = 0
    forecast_ms: int = 0
    story: list[str] = field(default_factory=list)
    # further commands, for checkpoints
    additions: list[dict[str, Any]] = field(default_factory=list)
    inspector: Inspector = field(default_factory=Inspector)
    rest: CellRest = field(default_factory=CellRest)
    paths: "RunPaths | None" = None  # in a run with motion

    def start(
        self,
        ready: ReadyPlan,
        world: SymbolicWorld,
        approve: bool = False,
        scope: RunScope | None = None,
    ) -> Finish:
        """Execute a first plan to the end of the run.

        `scope` says which of the goals it is for; all, if it is not given.
        """
        scope = scope or RunScope(self.problem)
        compiled = with_queues(ready.compiled, self.driver.lookahead)
        full = full_hands(ready.problem, ready.plan.steps, world.state.facts)
        standing = standing_of(compiled.program, self.driver.now_ms(), 1, unrested=full)
        course = self._course(compiled, standing, world)
        self.forecast_ms = ready.compiled.program.forecast_ms
        if ready.notes:
            self.recorder.note(
                RecordKind.DECISION, what="the first plan", why="; ".join(ready.notes)
            )
        outlook = standing_entry(compiled.program, standing, course.accuracy)
        course.planned({**plan_content(ready, "first", scope), **outlook})
        return self.guarded(course, scope, approve)

    def resume(self, past: PastRun) -> Finish:
        """Go on with a run whose journal was read.

        What was under way is settled with the driver first.
        """
        self.additions = list(past.additions)
        self.forecast_ms, self.exceptions, self.steps = (
            past.forecast_ms,
            past.exceptions,
            past.steps,
        )
        compiled, standing = taken_up(past, self.driver.lookahead, self.driver.now_ms())
        course = self._course(compiled, standing, past.world)
        restore_loop(course, past)
        stand_again(course, past.met, past.arms)
        course.values, course.spoilt = list(past.measured), list(past.spoilt)
        self.inspector.taken_up(past.lying, course)
        handler = ExceptionHandler(course, past.scope, self.base, self.limits, dict(past.cases))
        return self.guarded(course, past.scope, handler=handler, past=past)

    def _course(
        self, compiled: CompiledProgram, standing: ExecutiveState, world: SymbolicWorld
    ) -> RunLoop:
        return RunLoop(
            self.run,
            self.driver,
            self.recorder,
            self.orders,
            world,
            compiled,
            standing,
            memory=KeptHistory.of(self.base),
            every=RECORDS_PER_CHECKPOINT,
            measuring=MeasurementJudge(self.problem),
            measured=self.problem.domain.conventions.measured,
            paths=self.paths,
            rest=self.rest,
        )

    def guarded(
        self,
        course: RunLoop,
        scope: RunScope,
        approve: bool = False,
        handler: ExceptionHandler | None = None,
        past: PastRun | None = None,
    ) -> Finish:
        """Run to the end. If the journal cannot be written, everything halts: nothing is done
        that is not noted.
        """
        handler = handler or ExceptionHandler(course, scope, self.base, self.limits)
        handler.story = course.told = self.story
        course.checkpoint = Checkpoint(
            lambda: self._state(course, handler), lambda: remaining_pages(course)
        )
        try:
            if approve and not is_approved(course):
                return self._end(course, handler.scope, ABORTED, "the plan was not approved")
            if past is not None and (over := self._taken_up(course, handler, past)) is not None:
                return over
            return self._run(course, handler)
        except RunEnded as over:
            return self._end(course, handler.scope, STOPPED, over.turn.why)
        except JournalFailure as error:
            come_to_rest(course, halts=True)
            self._tell_unwritten(course)
            return self._ending(
                course, handler.scope, STOPPED, f"the journal cannot be written: {error}"
            )
        except StoppedByCaller:
            why = course.ending or f"{TOLD_TO_END} while a plan was made"
            return self._end(course, handler.scope, STOPPED, why)
        except BaseException as error:
            self._break_off(course, handler, error)
            raise

    def _break_off(self, course: RunLoop, handler: ExceptionHandler, error: BaseException) -> None:
        """Bring the cell to rest after an error of ours, and note that the run ended.

        What was noted since the last group may be half of something, so it is left out: whoever
        takes the run up again asks the driver.
        """
        self.rest.break_off(course.driver)
        with suppress(Exception), stopping.asking_to_stop(lambda: False):
            self.recorder.forget_unwritten()
            why = f"an error of the program: {type(error).__name__}: {error}"[:MAX_WHY_CHARACTERS]
            ending = self._ending(course, handler.scope, STOPPED, why)
            self.recorder.note(RecordKind.END, **end_entry(ending))
            self.recorder.commit()

    def _tell_unwritten(self, course: RunLoop) -> None:
        """Tell what was done that the journal does not hold, because it could not be written."""
        self.steps += len(course.done)
        self.story += [
            f"done, and not in the journal: step {record.content['step']}, "
            f"{record.content['action']}"
            for record in self.recorder.waiting
            if record.kind is RecordKind.DONE
        ]

    def _state(self, course: RunLoop, handler: ExceptionHandler) -> dict[str, Any]:
        """What a checkpoint holds."""
        return {
            **state_of(course),
            "cases": [[*key, count] for key, count in handler.cases.items()],
            "forecast_ms": self.forecast_ms,
            "exceptions": self.exceptions,
            "steps": self.steps + len(course.done) - len(course.written.done),
            "additions": self.additions,
            **({"lying": self.inspector.entry} if self.inspector.entry else {}),
        }

    def _run(self, course: RunLoop, handler: ExceptionHandler) -> Finish:
        while True:
            turn = course.go()
            if turn.given is not None:
                ended = self._changed(course, handler, turn.given)
            elif turn.review:
                self._reviewed(course, handler, turn.why)
                continue
            elif turn.idle:
                self._chosen(course, handler)
                continue
            elif turn.phase is RunPhase.HANDLING:
                ended = self._handled(course, handler, turn)
            elif turn.phase is RunPhase.FINISHED:
                ended = self._finished(course, handler)
            else:
                outcome = PAUSED if turn.phase is RunPhase.PAUSED else STOPPED
                return self._end(course, handler.scope, outcome, turn.why)
            if ended is not None:
                return ended

    def _taken_up(self, course: RunLoop, handler: ExceptionHandler, past: PastRun) -> Finish | None:
        """Settle what was under way when the run ended; the ending if it cannot go on."""
        if past.case:
            self.recorder.known = list(past.case)
            first = past.case[0].content
            rest_plan = left_over(course.compiled.plan, {StepId(number) for number in course.done})
            step = read_ground_atom(first["action"])
            handled = handler.handled(
                step, first["step"], first["command"], first["reply"], rest_plan
            )
            if isinstance(handled, GivesUp):
                return self._gives_up(course, handler, handled)
            self.follow(course, handler.scope, handled, "recovery")
            return None
        settle_commands(course, past)
        if past.replans:
            return self._changed(
                course, handler, GivenOrder(OperatorCommand.RETRY, origin=RESUME_ORIGIN)
            )
        return None

    def _handled(self, course: RunLoop, handler: ExceptionHandler, turn: LoopTurn) -> Finish | None:
        """Handle failures; the ending if nothing more can be done."""
        if not turn.failures:
            return self._end(course, handler.scope, STOPPED, turn.why)
        self.exceptions += len(turn.failures)
        handled = handler.handle(turn.failures)
        if isinstance(handled, GivesUp):
            return self._gives_up(course, handler, handled)
        self.follow(course, handler.scope, handled, "recovery")
        return None

    def _gives_up(self, course: RunLoop, handler: ExceptionHandler, reason: GivesUp) -> Finish:
        _, open_ = handler.scope.reached(self.problem, course.world.state)
        outcome = REACHED if not open_ else STOPPED if reason.stops else PARTLY
        return self._end(course, handler.scope, outcome, reason.why)

    def follow(
        self,
        course: RunLoop,
        scope: RunScope,
        ready_plan: ReadyPlan,
        why: str,
        standing: ExecutiveState | None = None,
    ) -> None:
        """Go on with another plan: with nothing done of it, or from a `standing` in which steps
        of it are under way.
        """
        self.steps += len(course.done)
        compiled = with_queues(ready_plan.compiled, self.driver.lookahead)
        fresh = standing or self._rested(course, scope, ready_plan, compiled)
        running = [
            [number, running_step.activity]
            for number, running_step in sorted(fresh.running.items())
        ]
        entry = {
            **plan_content(ready_plan, why, scope),
            **standing_entry(compiled.program, fresh, course.accuracy),
        }
        if ready_plan.notes:
            self.recorder.note(RecordKind.DECISION, what="times", why=" ".join(ready_plan.notes))
        course.planned({**entry, **({"running": running} if running else {})})
        course.world.chains = scope.problem.chains
        for chain in scope.problem.chains:
            course.world.reached.setdefault(chain.name, 0)
        course.follow(compiled, fresh)

    def _rested(
        self, course: RunLoop, scope: RunScope, ready_plan: ReadyPlan, compiled: CompiledProgram
    ) -> ExecutiveState:
        """The standing in which nothing of a plan is done.

        What is in a hand may be on its way to a goal.
        """
        full = full_hands(scope.problem, ready_plan.plan.steps, course.world.facts)
        return standing_of(
            compiled.program, self.driver.now_ms(), course.standing.number, unrested=full
        )

    def _changed(
        self, course: RunLoop, handler: ExceptionHandler, given: GivenOrder
    ) -> Finish | None:
        """What an order at a pause makes of the plan.

        An order that cannot be followed is told, and nothing changes.
        """
        if given.order is OperatorCommand.ABORT:
            course.halt()
            return self._end(course, handler.scope, ABORTED, "aborted by order")
        try:
            scope, joined_program = change_run(course, handler.scope, given, self.limits)
        except OrderRefused as error:
            self.recorder.note(
                RecordKind.DECISION, what=f"{given.order.value} refused", why=str(error)
            )
            return None
        if given.order is OperatorCommand.ADD:
            addition_entry = {
                "given": given.text,
                "wishes": wished_times(scope.problem),
                "behind": course.written.head,
            }
            self.additions.append(addition_entry)
            more = read_addition(handler.scope.problem, given.text)
            self.problem = (
                extend_problem(self.problem, more.words, ()) if more.words else self.problem
            )
        handler.scope = scope
        self.follow(course, scope, joined_program.ready, given.order.value, joined_program.standing)
        return None

    def _reviewed(self, course: RunLoop, handler: ExceptionHandler, why: str) -> None:
        """Follow a better plan for what is left, if there is one: one that keeps what this one
        would break, or is sooner done.
        """
        try:
            better = review_plan(course, handler.scope, self.limits)
        except InternalError as error:
            self._stays(course, error)
            return
        if better is not None:
            self.recorder.note(
                RecordKind.DECISION,
                what="another order of what is left",
                why=f"{why}: {better.why}",
            )
            self.follow(
                course, handler.scope, better.joined.ready, "reschedule", better.joined.standing
            )

    def _chosen(self, course: RunLoop, handler: ExceptionHandler) -> None:
        """Let equal things exchange their roles, if all is sooner done so."""
        try:
            choice = choose_exchange(course, handler.scope)
        except InternalError as error:
            self._stays(course, error)
            return
        if choice is not None:
            waited = course.waited
            self.recorder.note(
                RecordKind.DECISION,
                what=f"exchanged: {choice.what}",
                why="all is done sooner with what is free",
            )
            self.follow(
                course, handler.scope, choice.joined.ready, "choice", choice.joined.standing
            )
            course.waited = waited

    def _stays(self, course: RunLoop, error: InternalError) -> None:
        """Go on with the plan as it is: what is under way fits no other plan, because the cell has
        not done what its replies say, or we have a bug. Nothing was asked of the new plan yet.
        """
        course.looked = course.standing.done, frozenset(course.standing.running)
        course.calm *= 2
        self.recorder.note(
            RecordKind.DECISION, what="the plan stays as it is", why=str(error)[:MAX_WHY_CHARACTERS]
        )

    def _finished(self, course: RunLoop, handler: ExceptionHandler) -> Finish | None:
        """The end of the last plan: whether all original goals hold is looked up in the world,
        not taken from the plan. An inspection may go on.
        """
        further = self.inspector.onward(self.problem, course, handler, self.limits)
        if isinstance(further, GivesUp):
            return self._gives_up(course, handler, further)
        if further is not None:
            self.follow(course, handler.scope, further.ready, further.why)
            if further.why == ALIGNED:
                self.forecast_ms = further.ready.compiled.program.forecast_ms
            return None
        _, open_ = handler.scope.reached(self.problem, course.world.state)
        outcome = REACHED if not open_ else PARTLY
        why = "" if not open_ else f"{len(open_)} of the goals could not be reached"
        return self._end(course, handler.scope, outcome, why)

    def _end(self, course: RunLoop, scope: RunScope, outcome: str, why: str) -> Finish:
        with stopping.asking_to_stop(lambda: False):  # what is left to do is to come to rest
            come_to_rest(course, halts=outcome in (STOPPED, ABORTED))
            self.steps += len(course.done)
            ending = self._ending(course, scope, outcome, course.ending or why)
            self.recorder.note(RecordKind.END, **end_entry(ending))
            course.flush()
            return ending

    def _ending(self, course: RunLoop, scope: RunScope, outcome: str, why: str) -> Finish:
        goals, open_ = scope.reached(self.problem, course.world.state)
        return Finish(
            self.run,
            outcome,
            why,
            tuple(goals),
            tuple(open_),
            tuple((goal.goal, goal.why) for goal in scope.given_up),
            self.driver.now_ms(),
            self.forecast_ms,
            self.exceptions,
            self.steps,
            (*self.story, *left_out(self.driver)),
        )
