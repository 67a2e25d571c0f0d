"""True state of a simulated cell with hidden causes: effects and replies of steps and tests."""

import random
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

from cellwright.engine.model.run_protocol import OBSTRUCTED_REPLIES
from cellwright.engine.model.troubleshooting import CaseHypothesis
from cellwright.engine.pipelines.inspection.nominal_values import MeasurementJudge
from cellwright.engine.pipelines.recovery import (
    Dynamics,
    FaultyCell,
    KeptHistory,
    StepAchievement,
    SymbolicWorld,
    WorldState,
)
from cellwright.engine.pipelines.recovery.symbolic_world import achievement_of
from cellwright.engine.pipelines.simulators.simulated_cell import PhysicalBody, reading_by, told_by
from cellwright.engine.pipelines.simulators.simulator_settings import Injection
from cellwright.engine.stages.diagnosis.belief_revision import binding_of
from cellwright.engine.stages.diagnosis.fault_problems import CURED
from cellwright.engine.stages.diagnosis.hidden_cause import HiddenWorld
from cellwright.engine.stages.lifted.cell_domain import CellDomain, Situation, StepChange
from cellwright.engine.stages.lifted.lifted_execution import LiftedExecution
from cellwright.kb.asp import ground_term
from cellwright.kb.model.domain_model import Kind
from cellwright.kb.model.fault_model import FaultModel, Interruption
from cellwright.kb.model.plan_model import Step, StepId
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Function, match_term

if TYPE_CHECKING:
    from cellwright.engine.pipelines.simulators.true_part import PartTruth
    from cellwright.engine.pipelines.simulators.unmodelled import UnmodelledThings

MAX_SIGMA = 20.0  # the greatest standard deviation, and that of what has no limits
SIGMA_SHARE = 0.2  # of the way from the nominal value to a limit


class GoodPart:
    """Values near to the nominal ones, well inside of what is allowed.

    The same step measures the same in every run of a seed.
    """

    def __init__(self, problem: Problem, seed: int) -> None:
        self._measuring, self._seed = MeasurementJudge(problem), seed

    def value(self, step: Function, time: int) -> str:
        """What a step measures the n-th time it is taken: near to the nominal value, else to
        what is usual.
        """
        middle, scatter = self._usual(step)
        return str(round(middle + random.Random(f"{self._seed} {step} {time}").gauss(0, scatter)))

    def _usual(self, step: Function) -> tuple[float, float]:
        asked = self._measuring.expected(step)
        if asked is None:
            return 0.0, MAX_SIGMA
        if asked.nominal is None:
            return asked.usual, MAX_SIGMA
        ways = [
            abs(limit - asked.nominal) for limit in (asked.lower, asked.upper) if limit is not None
        ]
        return asked.nominal, min([MAX_SIGMA, *(SIGMA_SHARE * distance for distance in ways)])


def possible_exceptions(
    model: FaultModel, step: Function, cause: str = "", name: str = ""
) -> Iterator[Interruption]:
    """The exceptions that a step can have, for a cause if it is given."""
    for exception in model.exceptions.values():
        fits = (
            exception.operator is not None and match_term(exception.operator, step, {}) is not None
        )
        if fits and (not cause or cause in exception.counts) and name in ("", exception.name):
            yield exception


def exceptions_of_cause(model: FaultModel, step: Function, cause: str) -> tuple[str, ...]:
    """The exceptions by which a cause can show at a step."""
    return tuple(exception.name for exception in possible_exceptions(model, step, cause))


_read: dict[str, Function] = {}


def step_instance(text: str) -> Function:
    """The step in a command."""
    if text not in _read:
        if len(_read) > 1 << 14:
            _read.clear()
        term = ground_term(text)
        assert isinstance(term, Function)
        _read[text] = term
    return _read[text]


SILENT_REPLY = "timeout"  # the reply of the fault base for a step that is never answered
FAILED_REPLY = "failed"
VARIABLE_PATTERN = re.compile(r"\b(?:[A-Z]\w*|_)\b")


@dataclass
class HiddenFault:
    """A cause that is there, and the exception by which it showed."""

    cell: FaultyCell
    causes: tuple[str, ...]
    answers: HiddenWorld


@dataclass
class HiddenCell:
    """A cell as it really is. `faults` are there now; the state is that of `world` as long as none
    is.

    With a `body`, steps fail as physics has it. The cause is then the one that explains best where
    everything is.
    """

    problem: Problem
    model: FaultModel | None
    injections: Sequence[Injection] = ()
    seed: int = 0
    faults: list[HiddenFault] = field(default_factory=list)
    done: list[StepAchievement] = field(default_factory=list)
    times: dict[str, int] = field(default_factory=dict)
    helped: list[str] = field(default_factory=list)
    body: PhysicalBody | None = None
    truth: "PartTruth | None" = None
    unknown: "UnmodelledThings | None" = None
    # after the last step that physics has made fail, had it worked
    expected: WorldState | None = None

    def __post_init__(self) -> None:
        self.dynamics = Dynamics(self.problem)
        self.domain = CellDomain(self.problem)
        self._told: Mapping[str, Any] = {}
        self._know(self._start())
        self._good = GoodPart(self.problem, self.seed)
        needs_facts = (
            self.injections or self.body or (self.truth is not None and self.truth.drifting)
        )
        self._memory = KeptHistory.of(self.model if needs_facts else None)

    def _start(self) -> WorldState:
        """The state in which the cell really begins."""
        state, unknown = self.dynamics.start(), self.unknown
        return state if unknown is None else replace(state, facts=unknown.real(state.facts))

    def _know(self, state: WorldState) -> None:
        self.world = SymbolicWorld(self.problem.chains, set(state.facts), dict(state.reached))
        self.situation = Situation.of(self.domain, state.facts)

    def by_hand(self, adds: Sequence[str], ends: Sequence[str], reached: Mapping[str, int]) -> None:
        """A person has made facts true and others false, and brought chains so far."""
        now = self.world.state
        facts = now.facts.difference(map(step_instance, ends)).union(map(step_instance, adds))
        chains = {name: reached.get(name, number) for name, number in now.reached.items()}
        self._know(replace(now, facts=facts, reached=chains))

    def not_come(self) -> tuple[str, ...]:
        """The faults that were ordered for steps that were not taken so often."""
        late = (
            injection
            for injection in self.injections
            if self.times.get(injection.action, 0) < injection.time
        )
        return tuple(f"{injection.action}#{injection.time}={injection.cause}" for injection in late)

    def take(self, text: str, expects: str, part: Sequence[float] = ()) -> str | None:
        """Carry out a step with the part believed to lie there: its reply; None if none ever
        comes.
        """
        step, self._told = step_instance(text), {}
        for name in {str(step): None, step.name: None}:  # one name, if it has no arguments
            self.times[name] = self.times.get(name, 0) + 1
        if (reply_of_fault := self._injected(step) or self._drifted(step)) is not None:
            return self._fail(step, *reply_of_fault)
        if (failing := self._failing(step)) is not None:
            return failing
        if self.body is not None and not self.dynamics.refusal(step, self.world.state):
            before = self.world.state
            after = self.dynamics.after(step, before)
            if not self.body.carries_out(step, before.facts, after.facts):
                self._told = self.body.met()
                return (
                    OBSTRUCTED_REPLIES
                    if self._told
                    else self._shown(step, self.body, before, after)
                )
        if self._refused(step):
            return self._blind(step)
        if self.truth is not None:
            self.truth.drifting.calibrated(step)
        return self._sensed(step, expects) or self._reply(step, expects, part)

    def told(self) -> Mapping[str, Any]:
        """What has stopped the arm in the last step; empty if nothing has."""
        return self._told

    def _sensed(self, step: Function, expects: str) -> str:
        """The reply to a step that reads a sensor of a physical cell; empty for another one."""
        shown = reading_by(self.body, step) if expects.startswith("value(") else ""
        return f"value({shown})" if shown else ""

    def _drifted(self, step: Function) -> tuple[Injection, Interruption] | None:
        """How a calibration shows that its tool has drifted too far: by the exception that has
        the fewest causes beside this.
        """
        cause = self.truth.drifting.found(step) if self.truth else None
        if not cause or not self.model or any(cause in fault.causes for fault in self.faults):
            return None
        exception = min(
            possible_exceptions(self.model, step, cause),
            key=lambda candidate: len(candidate.counts),
            default=None,
        )
        return None if exception is None else (Injection(str(step), cause), exception)

    def _injected(self, step: Function) -> tuple[Injection, Interruption] | None:
        for injection in self.injections:
            if (
                self.model is not None
                and self.times.get(injection.action) == injection.time
                and injection.action in (str(step), step.name)
            ):
                exception = next(
                    possible_exceptions(self.model, step, injection.cause, injection.exception),
                    None,
                )
                if exception is not None:
                    return injection, exception
        return None

    def _fail(self, step: Function, injection: Injection, exception: Interruption) -> str | None:
        """A cause appears: the state is what it makes of the one in which the step began."""
        assert self.model is not None
        binding = binding_of(self.model, exception.name, step)
        cell = FaultyCell(
            self.dynamics, self.model, exception.name, binding, step, tuple(self.done)
        )
        state = cell.begun(self.world.state, (injection.cause,))
        self._know(state)
        chance = random.Random(f"{self.seed} {injection.action} {injection.cause}")
        self.faults.append(
            HiddenFault(
                cell,
                (injection.cause,),
                HiddenWorld(self.model, CaseHypothesis((injection.cause,)), chance),
            )
        )
        return None if exception.reply == SILENT_REPLY else exception.reply

    def _shown(
        self, step: Function, body: PhysicalBody, before: WorldState, after: WorldState
    ) -> str | None:
        """The reply to a step that physics has made fail, by the cause that explains best where
        everything is now.

        Of several that explain it as well, the most frequent one is there.
        """
        self.expected = after
        model, shown = self.model, list[tuple[int, float, Injection, Interruption]]()
        for exception_known in possible_exceptions(model, step) if model is not None else ():
            assert model is not None
            cell = FaultyCell(
                self.dynamics,
                model,
                exception_known.name,
                binding_of(model, exception_known.name, step),
                step,
            )
            for cause, count in exception_known.counts.items():
                facts = cell.begun(before, (cause,)).facts
                wrong = body.misfit(facts, before.facts, after.facts)
                shown.append((wrong, -count, Injection(str(step), cause), exception_known))
        if not shown:
            return FAILED_REPLY
        *_, injection, exception = min(shown, key=lambda candidate: candidate[:2])
        reply = self._fail(step, injection, exception)
        body.failed(self.world.facts)
        return reply

    def _failing(self, step: Function) -> str | None:
        """How a step fails because of what is there; None if nothing hinders it. Silence is
        answered late, as a failure.
        """
        for fault in self.faults:
            cause = fault.cell.failing(fault.causes, step)
            if cause:
                assert self.model is not None
                shown = next(possible_exceptions(self.model, step, cause), None) or next(
                    possible_exceptions(self.model, step), None
                )
                return shown.reply if shown is not None else FAILED_REPLY
        return None

    def _refused(self, step: Function) -> bool:
        """Take a step if it can be taken; whether it cannot."""
        if not self.faults:
            begun = LiftedExecution(self.domain, self.situation.facts)
            planned = Step(StepId(1), step)
            operator = self.domain.ground_step(step)
            wrong = (
                begun.take_known(planned, operator)
                if operator is not None
                else begun.take_any(planned)
            )
            if not wrong:
                self._took(step, begun.changes[StepId(1)])
                self.situation = Situation(self.domain, begun.facts)
            return bool(wrong)
        state = self.world.state
        if self.dynamics.refusal(step, state):
            return True
        for fault in self.faults:
            state = (
                fault.cell.taken(state, fault.causes, step) if fault is self.faults[0] else state
            )
        self._know(state)
        return False

    def _took(self, step: Function, change: StepChange) -> None:
        new = [atom for atom in (*change.adds, *change.events) if atom not in self.world.facts]
        moved = self.world.apply(change)
        work = achievement_of(len(self.done) + 1, step, new, moved)
        if self._memory.keeps(work):
            self.done.append(work)

    def _blind(self, step: Function) -> str:
        """The reply to a step whose precondition does not hold: how it shows that it cannot be
        done.
        """
        shown = None if self.model is None else next(possible_exceptions(self.model, step), None)
        return shown.reply if shown is not None else FAILED_REPLY

    def _reply(self, step: Function, expects: str, part: Sequence[float]) -> str:
        """A normal reply, with what is measured on the true part, or on a good one if nothing
        is said about it.
        """
        if expects == "done" or not expects:
            return "done"
        shown = self.truth.value(step, part) if self.truth is not None else None
        shown = shown or self._good.value(step, self.times[str(step)])
        return VARIABLE_PATTERN.sub(shown, expects)

    def missing(self, looked_at: Sequence[str]) -> str:
        """The first of some facts that is not so; empty if all are.

        Only what changes with the state can be missed here: fluents, and what is derived from them.
        """
        if not looked_at:
            return ""
        facts = self.dynamics.facts(self.world.state)
        predicates = self.problem.domain.predicates
        seen = {
            name
            for name, predicate in predicates.items()
            if predicate.kind in (Kind.FLUENT, Kind.DERIVED)
        }
        atoms = {text: step_instance(text) for text in looked_at}
        for text, atom in atoms.items():
            shown = reading_by(self.body, atom)
            if shown and str(atom.arguments[-1]) != shown:
                return text
            if not shown and atom.name in seen and atom not in facts:
                return text
        return ""

    def answer(self, action: str) -> str:
        """The outcome of a test or a repair. A repair that helps puts right what it was for."""
        assert self.model is not None
        action_model = self.model.tests.get(action) or self.model.repairs[action]
        for fault in self.faults or [self._sound()]:
            step = fault.cell.carried_out_by(action_model)
            if step is not None and not self.dynamics.refusal(step, self.world.state):
                self._know(fault.cell.taken(self.world.state, fault.causes, step))
        outcomes = [fault.answers.answer(action) for fault in self.faults] or [
            self._sound().answers.answer(action)
        ]
        if action in self.model.repairs:
            return self._repaired(action, outcomes)
        test = self.model.tests[action]
        if self.body is not None and (reading := told_by(self.body, test, self._is_usual)):
            return reading
        return next((outcome for outcome in outcomes if outcome != test.otherwise), test.otherwise)

    def _is_usual(self, sensor: str, shown: str) -> bool:
        """Whether a sensor would have a reading, had the last step worked that physics has made
        fail.
        """
        if self.expected is None:
            return False
        facts, terms = self.dynamics.facts(self.expected), (Function(sensor), Function(shown))
        return any(Function(name, terms) in facts for name in self.problem.domain.predicates)

    def _repaired(self, action: str, outcomes: Sequence[str]) -> str:
        assert self.model is not None
        cured = [
            fault for fault, outcome in zip(self.faults, outcomes, strict=False) if outcome == CURED
        ]
        for fault in cured:
            before = self.world.state.facts
            self._know(fault.cell.cured(self.world.state, self.model.repairs[action]))
            if self.truth is not None and (
                by := fault.cell.carried_out_by(self.model.repairs[action])
            ):
                self.truth.drifting.calibrated(by)
            self.faults.remove(fault)
            self.helped.append(action)
            if self.body is not None:
                self.body.repaired(before, self.world.state.facts)
        return CURED if cured else outcomes[0]

    def _sound(self) -> HiddenFault:
        """A cell in which no cause is there, for tests that are made all the same."""
        assert self.model is not None
        cell = FaultyCell(self.dynamics, self.model, next(iter(self.model.exceptions)), {})
        return HiddenFault(
            cell, (), HiddenWorld(self.model, CaseHypothesis(()), random.Random(self.seed))
        )

    def say(self, choices: Sequence[str]) -> str:
        """What a person answers who looks into the cell: the causes that are there, if they are
        among the choices.
        """
        named = " and ".join(cause for fault in self.faults for cause in fault.causes)
        return next(
            (choice for choice in choices if choice == named), choices[-1] if choices else "done"
        )
