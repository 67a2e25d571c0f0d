"""A whole run: plan, execute, handle exceptions, plan on, until the goals are reached or nothing more can be done."""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from cellwright.engine.model.execution import Finish, Order, Phase, RecordKind
from cellwright.engine.pipelines.execution.adding import addition, extended, wished
from cellwright.engine.pipelines.execution.approval import approved
from cellwright.engine.pipelines.execution.checkpoints import rest_of, state_of
from cellwright.engine.pipelines.execution.compiling import Compiled, full_hands, queued
from cellwright.engine.pipelines.execution.course import Course
from cellwright.engine.pipelines.execution.handling import ExceptionHandler, GivesUp
from cellwright.engine.pipelines.execution.hands import Ended
from cellwright.engine.pipelines.execution.inspector import ALIGNED, Inspector
from cellwright.engine.pipelines.execution.meeting import stand_again
from cellwright.engine.pipelines.execution.orders import Given, Orders
from cellwright.engine.pipelines.execution.pauses import RESUME, Refused, changed
from cellwright.engine.pipelines.execution.planned import Ready
from cellwright.engine.pipelines.execution.progress import EVERY, Checkpoint, Turn
from cellwright.engine.pipelines.execution.recorder import Recorder
from cellwright.engine.pipelines.execution.records import end_entry, plan_entry, read_atom, standing_entry
from cellwright.engine.pipelines.execution.resuming import Past
from cellwright.engine.pipelines.execution.reviewing import chosen, reviewed
from cellwright.engine.pipelines.execution.scope import Scope
from cellwright.engine.pipelines.execution.settling import left_out, restore, settle, taken_up
from cellwright.engine.pipelines.measuring import Measuring
from cellwright.engine.pipelines.revision.remaining import left_over
from cellwright.engine.pipelines.simulation import Memory, SymbolicWorld
from cellwright.engine.ports import Driver
from cellwright.engine.stages.execution import Standing, standing_of
from cellwright.engine.stages.planning import Limits
from cellwright.kb.model.faults import FaultModel
from cellwright.kb.model.plan import StepId
from cellwright.kb.model.problem import Problem
from cellwright.kb.store.journal import JournalFailure

if TYPE_CHECKING:
    from cellwright.engine.pipelines.execution.paths import Paths

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
    story: list[str] = field(default_factory=list)
    additions: list[dict[str, Any]] = field(default_factory=list)  # further commands, for checkpoints
    inspector: Inspector = field(default_factory=Inspector)
    paths: "Paths | None" = None  # in a run with motion

    def start(
        self, ready: Ready, world: SymbolicWorld, approve: bool = False, scope: Scope | None = None
    ) -> Finish:
        """Execute a first plan to the end of the run. `scope` says which of the goals it is for; all, if it is not given."""
        scope = scope or Scope(self.problem)
        compiled = queued(ready.compiled, self.driver.lookahead)
        full = full_hands(ready.problem, ready.plan.steps, world.state.facts)
        standing = standing_of(compiled.program, self.driver.now_ms(), 1, unrested=full)
        course = self._course(compiled, standing, world)
        self.forecast_ms = ready.compiled.program.forecast_ms
        if ready.notes:
            self.recorder.note(RecordKind.DECISION, what="the first plan", why="; ".join(ready.notes))
        outlook = standing_entry(compiled.program, standing, course.accuracy)
        course.planned({**plan_entry(ready, "first", scope), **outlook})
        return self.guarded(course, scope, approve)

    def resume(self, past: Past) -> Finish:
        """Go on with a run whose journal was read. What was under way is settled with the driver first."""
        self.additions = list(past.additions)
        self.forecast_ms, self.exceptions, self.steps = past.forecast_ms, past.exceptions, past.steps
        compiled, standing = taken_up(past, self.driver.lookahead, self.driver.now_ms())
        course = self._course(compiled, standing, past.world)
        restore(course, past)
        stand_again(course, past.met, past.arms)
        course.values, course.spoilt = list(past.measured), list(past.spoilt)
        self.inspector.taken_up(past.lying, course)
        handler = ExceptionHandler(course, past.scope, self.base, self.limits, dict(past.cases))
        return self.guarded(course, past.scope, handler=handler, past=past)

    def _course(self, compiled: Compiled, standing: Standing, world: SymbolicWorld) -> Course:
        return Course(
            self.run,
            self.driver,
            self.recorder,
            self.orders,
            world,
            compiled,
            standing,
            memory=Memory.of(self.base),
            every=EVERY,
            measuring=Measuring(self.problem),
            measured=self.problem.domain.conventions.measured,
            paths=self.paths,
        )

    def guarded(
        self,
        course: Course,
        scope: Scope,
        approve: bool = False,
        handler: ExceptionHandler | None = None,
        past: Past | None = None,
    ) -> Finish:
        """Run to the end. If the journal cannot be written, everything halts: nothing is done that is not noted."""
        handler = handler or ExceptionHandler(course, scope, self.base, self.limits)
        handler.story = course.told = self.story
        course.checkpoint = Checkpoint(lambda: self._state(course, handler), lambda: rest_of(course))
        try:
            if approve and not approved(course):
                return self._end(course, handler.scope, ABORTED, "the plan was not approved")
            if past is not None and (over := self._taken_up(course, handler, past)) is not None:
                return over
            return self._run(course, handler)
        except Ended as over:
            return self._end(course, handler.scope, STOPPED, over.turn.why)
        except JournalFailure as error:
            self.driver.halt()
            course.outbox.clear()
            return self._ending(course, handler.scope, STOPPED, f"the journal cannot be written: {error}")

    def _state(self, course: Course, handler: ExceptionHandler) -> dict[str, Any]:
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

    def _run(self, course: Course, handler: ExceptionHandler) -> Finish:
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
            elif turn.phase is Phase.HANDLING:
                ended = self._handled(course, handler, turn)
            elif turn.phase is Phase.FINISHED:
                ended = self._finished(course, handler)
            else:
                outcome = PAUSED if turn.phase is Phase.PAUSED else STOPPED
                return self._end(course, handler.scope, outcome, turn.why)
            if ended is not None:
                return ended

    def _taken_up(self, course: Course, handler: ExceptionHandler, past: Past) -> Finish | None:
        """Settle what was under way when the run ended; the ending if it cannot go on."""
        if past.case:
            self.recorder.known = list(past.case)
            first = past.case[0].content
            left = left_over(course.compiled.plan, {StepId(each) for each in course.done})
            step = read_atom(first["action"])
            found = handler.handled(step, first["step"], first["command"], first["reply"], left)
            if isinstance(found, GivesUp):
                return self._gives_up(course, handler, found)
            self.follow(course, handler.scope, found, "recovery")
            return None
        settle(course, past)
        if past.replans:
            return self._changed(course, handler, Given(Order.RETRY, origin=RESUME))
        return None

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

    def follow(
        self, course: Course, scope: Scope, found: Ready, why: str, standing: Standing | None = None
    ) -> None:
        """Go on with another plan: with nothing done of it, or from a `standing` in which steps of it are under way."""
        self.steps += len(course.done)
        compiled = queued(found.compiled, self.driver.lookahead)
        fresh = standing or self._rested(course, scope, found, compiled)
        running = [[number, each.activity] for number, each in sorted(fresh.running.items())]
        entry = {**plan_entry(found, why, scope), **standing_entry(compiled.program, fresh, course.accuracy)}
        if found.notes:
            self.recorder.note(RecordKind.DECISION, what="times", why=" ".join(found.notes))
        course.planned({**entry, **({"running": running} if running else {})})
        course.world.chains = scope.problem.chains
        for chain in scope.problem.chains:
            course.world.reached.setdefault(chain.name, 0)
        course.follow(compiled, fresh)

    def _rested(self, course: Course, scope: Scope, found: Ready, compiled: Compiled) -> Standing:
        """The standing in which nothing of a plan is done. What is in a hand may be on its way to a goal."""
        full = full_hands(scope.problem, found.plan.steps, course.world.facts)
        return standing_of(compiled.program, self.driver.now_ms(), course.standing.number, unrested=full)

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
        if given.order is Order.ADD:
            said = {"given": given.text, "wishes": wished(scope.problem), "behind": course.written.head}
            self.additions.append(said)
            more = addition(handler.scope.problem, given.text)
            self.problem = extended(self.problem, more.words, ()) if more.words else self.problem
        handler.scope = scope
        self.follow(course, scope, found.ready, given.order.value, found.standing)
        return None

    def _reviewed(self, course: Course, handler: ExceptionHandler, why: str) -> None:
        """Follow a better plan for what is left, if there is one: one that keeps what this one would break, or is sooner done."""
        found = reviewed(course, handler.scope, self.limits)
        if found is not None:
            self.recorder.note(
                RecordKind.DECISION, what="another order of what is left", why=f"{why}: {found.why}"
            )
            self.follow(course, handler.scope, found.joined.ready, "reschedule", found.joined.standing)

    def _chosen(self, course: Course, handler: ExceptionHandler) -> None:
        """Let equal things exchange their roles, if all is sooner done so."""
        found = chosen(course, handler.scope)
        if found is not None:
            waited = course.waited
            self.recorder.note(
                RecordKind.DECISION,
                what=f"exchanged: {found.what}",
                why="all is done sooner with what is free",
            )
            self.follow(course, handler.scope, found.joined.ready, "choice", found.joined.standing)
            course.waited = waited

    def _finished(self, course: Course, handler: ExceptionHandler) -> Finish | None:
        """The end of the last plan: whether all original goals hold is looked up in the world, not taken from the plan. An inspection may go on."""
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

    def _end(self, course: Course, scope: Scope, outcome: str, why: str) -> Finish:
        self.steps += len(course.done)
        ending = self._ending(course, scope, outcome, why)
        self.recorder.note(RecordKind.END, **end_entry(ending))
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
            (*self.story, *left_out(self.driver)),
        )
