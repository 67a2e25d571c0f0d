"""Windows of a plan, planned anew as stable models of bounded cost.

Each answer lowers the bound for the next.
"""

from collections.abc import Sequence

from cellwright.engine.model.task import Bits, GroundOperator, indices
from cellwright.engine.stages.planning.effort import Effort
from cellwright.engine.stages.planning.relaxed import levels
from cellwright.engine.stages.planning.stable_models.encoding import OPTIONS, PARALLEL, STEP, facts, sequence
from cellwright.kb.asp.steps import Solver

SHORT = 12  # up to this length the replacement has one step less; for longer windows about half
BELOW = """
:- #sum { C,O,T : occurs(O,T), weight(O,C) } >= b.
"""


class Windows:
    """Replaces windows of plans over atoms below `size` by cheaper ones. It is a `Cheaper`.

    A window may take `conflicts` conflicts of the solver.
    """

    def __init__(
        self, operators: Sequence[GroundOperator], groups: Sequence[Bits], size: int, conflicts: int
    ) -> None:
        self.operators, self.groups, self.size, self.conflicts = operators, groups, size, conflicts

    def __call__(
        self, state: Bits, goals: Bits, window: Sequence[GroundOperator], effort: Effort
    ) -> list[GroundOperator] | None:
        """The cheapest replacement for `window` that is found; None if none is cheaper."""
        solver = self._solver(state, goals, len(window))
        best: list[GroundOperator] | None = None
        while solver is not None and not effort.over() and solver.conflicts < self.conflicts:
            solver.ground([("below", (self._weighed(window if best is None else best, len(window)),))])
            before = solver.conflicts
            found = solver.solve((), self.conflicts - before, effort.interrupted)
            effort.generated += 1 + solver.conflicts - before
            if not isinstance(found, frozenset):
                break
            best = sequence(self.operators, found)
        return best

    def _solver(self, state: Bits, goals: Bits, length: int) -> Solver | None:
        """The program of one window; None if the goals cannot be reached within the horizon."""
        horizon = length - 1 if length <= SHORT else max(SHORT - 1, length // 2)
        reached, first = levels(state, self.operators, self.size)
        if any(not 0 <= reached[atom] <= horizon for atom in indices(goals)):
            return None
        possible = [step if step <= horizon else -1 for step in first]
        text = [*facts(state, self.operators, possible, self.groups, self.size)]
        weights = (self._weighed([operator], length) for operator in self.operators)
        text += [f"weight({n},{w})." for n, w in enumerate(weights) if possible[n] >= 0]
        text += [f":- not holds({atom},{horizon})." for atom in indices(goals)]
        steps = [("step", (number,)) for number in range(1, horizon + 1)]
        parts = {"base": ((), " ".join(text)), "step": (("t",), STEP + PARALLEL), "below": (("b",), BELOW)}
        solver = Solver(parts, OPTIONS)
        solver.ground([("base", ()), *steps])
        return solver

    def _weighed(self, steps: Sequence[GroundOperator], length: int) -> int:
        """A number that compares by cost first, and by the number of steps if costs are equal."""
        return sum(each.cost * (length + 1) + 1 for each in steps)
