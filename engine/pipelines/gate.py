"""The gate: every plan that the engine gives out passes the independent checker here, whoever made it.

A gate keeps the static facts of the cells that it met lately, evaluated by the checker, so that the next plan for such a
cell is checked in milliseconds. It decides nothing about what becomes of a plan that is refused.
"""

from engine.stages.validation import findings
from engine.stages.validation.changes import State
from engine.stages.validation.semantics import Semantics
from kb.diagnostics import Diagnostic
from kb.model.plan import Plan, in_sequence
from kb.model.problem import Problem

CELLS = 8  # whose static facts are kept
UNSHOWN = (
    "K503",
    "K506",
)  # steps may interfere, or reach the stages of a chain in another order than the plan means


class InternalError(Exception):
    """The engine made a plan that its own checker refuses: a bug. Carries the checker's findings."""

    def __init__(self, diagnostics: list[Diagnostic]) -> None:
        super().__init__("the checker refuses the plan:\n" + "\n".join(map(str, diagnostics)))


class PlanGate:
    """The checker, and what it knows of the cells that were met lately."""

    def __init__(self) -> None:
        self._cells: list[Semantics] = []

    def semantics(self, problem: Problem, state: State | None = None) -> Semantics:
        """What the operators of a problem mean; `state` stands for its initial state."""
        for place, known in enumerate(self._cells):
            if (found := known.about(problem, state)) is not None:
                self._cells.insert(0, self._cells.pop(place))
                return found
        fresh = Semantics(problem)
        self._cells = [fresh, *self._cells[: CELLS - 1]]
        return fresh if state is None else fresh.about(problem, state) or fresh

    def findings(self, problem: Problem, plan: Plan, state: State | None = None) -> list[Diagnostic]:
        """Everything that the checker has against a plan; `state` stands for the initial state of the problem."""
        return findings(self.semantics(problem, state), plan)

    def settled(self, problem: Problem, plan: Plan) -> tuple[Plan, list[Diagnostic]]:
        """The plan as it may be given out, and what is wrong with it: as a sequence, if all that the checker cannot show is
        that some steps need no order."""
        wrong = self.findings(problem, plan)
        if wrong and all(each.code in UNSHOWN for each in wrong):
            plan = in_sequence(plan)
            wrong = self.findings(problem, plan)
        return plan, wrong

    def accepted(self, problem: Problem, plan: Plan) -> Plan:
        """The plan as it may be given out. Raises `InternalError` if it may not."""
        made, wrong = self.settled(problem, plan)
        if wrong:
            raise InternalError(wrong)
        return made


def accepted(problem: Problem, plan: Plan) -> Plan:
    """`PlanGate.accepted` for a plan that comes alone."""
    return PlanGate().accepted(problem, plan)
