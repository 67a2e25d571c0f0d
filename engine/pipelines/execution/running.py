"""A whole run: plan, execute, handle exceptions, plan on, until the goals are reached or nothing more can be done."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from engine.model.execution import Finish, Order, Phase, RecordKind
from engine.pipelines.attainment import GivenUp
from engine.pipelines.execution.course import Course, Turn
from engine.pipelines.execution.handling import ExceptionHandler, GivesUp
from engine.pipelines.execution.hands import Ended
from engine.pipelines.execution.orders import Given, Orders
from engine.pipelines.execution.pauses import Refused, changed
from engine.pipelines.execution.planned import Ready
from engine.pipelines.execution.recorder import Recorder
from engine.pipelines.execution.records import plan_entry
from engine.pipelines.execution.scope import Scope
from engine.pipelines.simulation import World
from engine.ports import Driver
from engine.stages.execution import Program, standing_of
from engine.stages.planning import Limits
from kb.model.faults import FaultModel
from kb.model.problem import Problem
from kb.store.journal import JournalFailure

REACHED, PARTLY, STOPPED, ABORTED, PAUSED = "reached", "partly", "stopped", "aborted", "paused"


@dataclass
class Execution:
    """One run. `problem` is as it was given; `scope` is what is still pursued of it."""

    run: str
    problem: Problem
    driver: Driver
    recorder: Recorder
    orders: Orders
    base: FaultModel | None = None
    limits: Limits = field(default_factory=Limits)
    steps: int = 0
    exceptions: int = 0
    forecast_ms: int = 0

    def start(self, ready: Ready, world: World, approve: bool = False) -> Finish:
        """Execute a first plan to the end of the run."""
        course = self._course(ready, world)
        self.forecast_ms = ready.compiled.program.forecast_ms
        self.recorder.note(RecordKind.PLAN, **plan_entry(ready, "first", Scope(self.problem)))
        return self.guarded(course, Scope(self.problem), approve)

    def _course(self, ready: Ready, world: World) -> Course:
        compiled = self._queued(ready)
        standing = standing_of(compiled.compiled.program, self.driver.now_ms(), 1)
        spoils = self.base is not None and any(cause.spoils for cause in self.base.causes.values())
        return Course(
            self.run,
            self.driver,
            self.recorder,
            self.orders,
            world,
            compiled.compiled,
            standing,
            keeps_history=spoils,
        )

    def _queued(self, ready: Ready) -> Ready:
        """The program with the queues that the driver's devices have."""
        program = ready.compiled.program
        streams = {a.stream for a in program.activities.values() if not a.process}
        depths = {stream: self.driver.lookahead(stream) for stream in sorted(streams)}
        queues = {stream: depth for stream, depth in depths.items() if depth > 1}
        made: Program = replace(program, lookahead=queues)
        return replace(ready, compiled=replace(ready.compiled, program=made))

    def guarded(self, course: Course, scope: Scope, approve: bool = False) -> Finish:
        """Run to the end. If the journal cannot be written, everything halts: nothing is done that is not noted."""
        handler = ExceptionHandler(course, scope, self.base, self.limits)
        try:
            if approve and not self._approved(course):
                return self._end(course, handler.scope, ABORTED, "the plan was not approved")
            return self._run(course, handler)
        except Ended as over:
            return self._end(course, handler.scope, STOPPED, over.turn.why)
        except JournalFailure as error:
            self.driver.halt()
            course.outbox.clear()
            return self._ending(course, handler.scope, STOPPED, f"the journal cannot be written: {error}")

    def _approved(self, course: Course) -> bool:
        self.recorder.note(RecordKind.PHASE, phase=Phase.READY.value, why="waits for approval")
        course.flush()
        while True:
            for given in self.orders.due(self.driver.now_ms()):
                course.order(given)
                if given.order in (Order.APPROVE, Order.STOP, Order.ABORT):
                    return given.order is Order.APPROVE
            if not self.orders.wait():
                return False

    def _run(self, course: Course, handler: ExceptionHandler) -> Finish:
        while True:
            turn = course.go()
            self.steps += len(course.done)
            if turn.given is not None:
                ended = self._changed(course, handler, turn.given)
            elif turn.phase is Phase.HANDLING:
                ended = self._handled(course, handler, turn)
            elif turn.phase is Phase.FINISHED:
                return self._finished(course, handler)
            else:
                outcome = PAUSED if turn.phase is Phase.PAUSED else STOPPED
                return self._end(course, handler.scope, outcome, turn.why)
            if ended is not None:
                return ended

    def _handled(self, course: Course, handler: ExceptionHandler, turn: Turn) -> Finish | None:
        """Handle failures; the ending if nothing more can be done."""
        if not turn.failures:
            return self._end(course, handler.scope, STOPPED, turn.why)
        self.exceptions += len(turn.failures)
        found = handler.handle(turn.failures)
        if isinstance(found, GivesUp):
            return self._gives_up(course, handler, found)
        self.follow(course, handler.scope, found, "recovery")
        return None

    def _gives_up(self, course: Course, handler: ExceptionHandler, found: GivesUp) -> Finish:
        _, open_ = handler.scope.reached(self.problem, course.world.state)
        outcome = REACHED if not open_ else STOPPED if found.stops else PARTLY
        return self._end(course, handler.scope, outcome, found.why)

    def follow(self, course: Course, scope: Scope, found: Ready, why: str) -> None:
        """Go on with another plan."""
        compiled = self._queued(found).compiled
        now = self.driver.now_ms()
        self.recorder.note(RecordKind.PLAN, **plan_entry(found, why, scope))
        course.follow(compiled, standing_of(compiled.program, now, course.standing.number))

    def _changed(self, course: Course, handler: ExceptionHandler, given: Given) -> Finish | None:
        """What an order at a pause makes of the plan. An order that cannot be followed is told, and nothing changes."""
        if given.order is Order.ABORT:
            self.driver.halt()
            return self._end(course, handler.scope, ABORTED, "aborted by order")
        try:
            scope, found = changed(course, handler.scope, given, self.limits)
        except Refused as error:
            self.recorder.note(RecordKind.DECISION, what=f"{given.order.value} refused", why=str(error))
            return None
        handler.scope = scope
        self.follow(course, scope, found, given.order.value)
        return None

    def _finished(self, course: Course, handler: ExceptionHandler) -> Finish:
        """The end of the last plan: whether all original goals hold is looked up in the world, not taken from the plan."""
        _, open_ = handler.scope.reached(self.problem, course.world.state)
        outcome = REACHED if not open_ else PARTLY
        why = "" if not open_ else f"{len(open_)} of the goals could not be reached"
        return self._end(course, handler.scope, outcome, why)

    def _end(self, course: Course, scope: Scope, outcome: str, why: str) -> Finish:
        ending = self._ending(course, scope, outcome, why)
        self.recorder.note(
            RecordKind.END,
            outcome=outcome,
            why=why,
            goals=list(ending.goals),
            open_goals=list(ending.open_goals),
            given_up=[list(each) for each in ending.given_up],
            makespan_ms=ending.makespan_ms,
        )
        course.flush()
        return ending

    def _ending(self, course: Course, scope: Scope, outcome: str, why: str) -> Finish:
        goals, open_ = scope.reached(self.problem, course.world.state)
        return Finish(
            self.run,
            outcome,
            why,
            tuple(goals),
            tuple(open_),
            tuple((each.goal, each.why) for each in scope.given_up),
            self.driver.now_ms(),
            self.forecast_ms,
            self.exceptions,
            self.steps,
        )


def given_up(entries: Sequence[Sequence[str]]) -> tuple[GivenUp, ...]:
    """The goals given up, as the journal has them."""
    return tuple(GivenUp(goal, why) for goal, why in entries)
