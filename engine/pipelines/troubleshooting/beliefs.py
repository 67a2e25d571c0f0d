"""What the world is believed to be while a case is open: one state for each hypothesis, which all that is done moves on."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import reduce

from cellwright.engine.model.cases import Hypothesis, Prepared
from cellwright.engine.pipelines.barring import barred
from cellwright.engine.pipelines.simulation import FaultyCell, WorldState
from cellwright.engine.pipelines.troubleshooting.preparations import Preparations
from cellwright.engine.stages.diagnosis.knowledge import CURED
from cellwright.engine.stages.diagnosis.session import Session
from cellwright.kb.model.faults import FaultTest, Repair
from cellwright.kb.model.plan import Plan
from cellwright.kb.terms import Function

Causes = tuple[str, ...]
Bars = tuple[tuple[str, ...], tuple[Function, ...]]  # what is lost, and what fails
NOTHING: Causes = ()


@dataclass
class Beliefs:
    """The states of a cell under each hypothesis. `before` is the state in which the interrupted step began.

    `deeds` are the steps that were taken for tests and repairs; a repair that helped comes last.
    """

    cell: FaultyCell
    before: WorldState
    preparations: Preparations
    deeds: list[Function] = field(default_factory=list)
    helped: Repair | None = None
    _known: dict[Causes, tuple[int, WorldState]] = field(default_factory=dict)
    _without: dict[Bars, Preparations] = field(default_factory=dict)

    def state(self, causes: Causes) -> WorldState:
        """The state if these are the causes, after everything that was done."""
        count, state = self._known.get(causes) or (0, self.cell.begun(self.before, causes))
        for step in self.deeds[count:]:
            state = self.cell.taken(state, causes, step)
        self._known[causes] = (len(self.deeds), state)
        return self.cell.cured(state, self.helped) if self.helped else state

    def common(self, hypotheses: Iterable[Hypothesis]) -> WorldState:
        """What is sure if one of some hypotheses is true."""
        states = [self.state(causes) for causes in dict.fromkeys(each.causes for each in hypotheses)]
        return reduce(WorldState.common, states) if states else self.state(NOTHING)

    def prepare(self, session: Session, action: str) -> Prepared | None:
        """The steps that bring about what an action needs, whatever the cause is; else if it is the most probable one.

        None if there is no plan for it that the causes leave to be taken.
        """
        goal = self.preparations.goal(self._action(action).preconditions)
        believed = [hypothesis for hypothesis, _ in session.belief()]
        for among in (believed, believed[:1]):
            plan = self._spared(among).plan_from(self.common(among).facts, goal)
            if plan is not None:
                return _prepared(plan)
        return None

    def _spared(self, among: Sequence[Hypothesis]) -> Preparations:
        """The preparations that take no step which fails under one of some hypotheses."""
        causes = tuple(dict.fromkeys(cause for hypothesis in among for cause in hypothesis.causes))
        lost = tuple(sorted({str(term) for cause in causes for term in self.cell.lost(cause)}))
        blocked = tuple(dict.fromkeys(step for cause in causes for step in self.cell.blocked(cause)))
        if not lost and not blocked:
            return self.preparations
        if (lost, blocked) not in self._without:
            problem = barred(self.preparations.problem, lost, blocked)
            self._without[lost, blocked] = replace(self.preparations, problem=problem, plans={}, states=[])
        return self._without[lost, blocked]

    def repaired(self, session: Session, repair: str) -> "tuple[Beliefs, Prepared] | None":
        """What would be believed after a repair that helps, and the steps that prepare it; None if it cannot be prepared."""
        prepared = self.prepare(session, repair)
        if prepared is None:
            return None
        later = replace(self, deeds=list(self.deeds), _known=dict(self._known))
        later.carried_out(repair, CURED, prepared)
        return later, prepared

    def carried_out(self, action: str, outcome: str, prepared: Prepared) -> None:
        """Take in the steps that prepared an action, the step that did it, and the repair if it helped."""
        self.deeds += [step.operator for step in prepared.steps]
        done = self._action(action)
        step = self.cell.carried_out_by(done)
        self.deeds += [step] if step is not None else []
        if isinstance(done, Repair) and outcome == CURED:
            self.helped = done

    def _action(self, name: str) -> FaultTest | Repair:
        return self.cell.model.tests.get(name) or self.cell.model.repairs[name]


def _prepared(plan: Plan) -> Prepared:
    return Prepared(plan.steps, float(sum(step.duration for step in plan.steps)))
