"""The gate: every plan that the engine gives out passes the independent checker here.

A gate keeps the evaluated static facts of the last few cells, so that the next plan for one of them
is checked in milliseconds. It does not decide what happens to a plan that is refused: that is left
to its caller.
"""

from cellwright.engine.stages.validation import plan_findings
from cellwright.engine.stages.validation.operator_semantics import Semantics
from cellwright.engine.stages.validation.step_changes import State
from cellwright.kb.diagnostics import Diagnostic, InvalidInput
from cellwright.kb.model.plan_model import Plan, full_order
from cellwright.kb.model.planning_problem import Problem

MAX_KEPT_SEMANTICS = 8  # the number of cells whose static facts are kept
UNSHOWN = (
    "K503",  # unordered steps may interfere
    "K506",  # unordered steps may reach the stages of a chain in another order than planned
)


class InternalError(Exception):
    """The engine made a plan that its own checker refuses.

    This is a bug. The message holds the checker's findings.
    """

    def __init__(self, diagnostics: list[Diagnostic]) -> None:
        super().__init__("the checker refuses the plan:\n" + "\n".join(map(str, diagnostics)))


def refusal_error(wrong: list[Diagnostic]) -> InternalError | InvalidInput:
    """What to raise for a plan that the checker refuses: a domain may contradict itself where
    only this plan leads; else it is a bug.
    """
    at_fault = all(diagnostic.code == "K301" for diagnostic in wrong)
    return InvalidInput(wrong) if at_fault else InternalError(wrong)


class PlanGate:
    """The checker, and what it has evaluated for the last few cells."""

    def __init__(self, most: int = MAX_KEPT_SEMANTICS) -> None:
        self._most = most
        self._cells: list[Semantics] = []

    def semantics(self, problem: Problem, state: State | None = None) -> Semantics:
        """The semantics of a problem's operators; `state`, if given, replaces the initial state."""
        for place, known_semantics in enumerate(self._cells):
            if (semantics := known_semantics.about(problem, state)) is not None:
                self._cells.insert(0, self._cells.pop(place))
                return semantics
        fresh = Semantics(problem)
        self._cells = [fresh, *self._cells[: self._most - 1]]
        return fresh if state is None else fresh.about(problem, state) or fresh

    def findings(
        self, problem: Problem, plan: Plan, state: State | None = None
    ) -> list[Diagnostic]:
        """All errors that the checker finds in a plan; `state`, if given, replaces the initial
        state.
        """
        return plan_findings(self.semantics(problem, state), plan)

    def settled(self, problem: Problem, plan: Plan) -> tuple[Plan, list[Diagnostic]]:
        """The plan as it may be given out, and what is wrong with it.

        The checker may only fail to show that some steps need no order. The plan is then made a
        sequence and checked again.
        """
        wrong = self.findings(problem, plan)
        if wrong and all(diagnostic.code in UNSHOWN for diagnostic in wrong):
            plan = full_order(plan)
            wrong = self.findings(problem, plan)
        return plan, wrong

    def accepted(self, problem: Problem, plan: Plan) -> Plan:
        """The plan as it may be given out.

        Raises `InternalError` or `InvalidInput` if it may not.
        """
        made, wrong = self.settled(problem, plan)
        if wrong:
            raise refusal_error(wrong)
        return made


def accept_plan(problem: Problem, plan: Plan) -> Plan:
    """`PlanGate.accepted` for a single plan."""
    return PlanGate().accepted(problem, plan)
