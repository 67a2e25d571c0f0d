"""Windows planned anew by stable models of bounded cost, each answer bounding the next."""

from collections.abc import Sequence

from engine.model.task import Bits, GroundOperator, indices
from engine.stages.planning.effort import Effort
from engine.stages.planning.relaxed import levels
from engine.stages.planning.stable_models.encoding import OPTIONS, PARALLEL, STEP, facts, sequence
from kb.asp.steps import Solver

SHORT = 12  # steps up to which a replacement may take one step less; longer ones do some of it at once
BELOW = """
:- #sum { C,O,T : occurs(O,T), weight(O,C) } >= b.
"""


class Windows:
    """Stretches of plans over atoms below `size`, with so many conflicts for each; a `Cheaper`."""

    def __init__(
        self, operators: Sequence[GroundOperator], groups: Sequence[Bits], size: int, conflicts: int
    ) -> None:
        self.operators, self.groups, self.size, self.conflicts = operators, groups, size, conflicts

    def __call__(
        self, state: Bits, goals: Bits, window: Sequence[GroundOperator], effort: Effort
    ) -> list[GroundOperator] | None:
        """A cheaper way than `window`, the cheapest that is found."""
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
        """The program of one window; None if the goals are further away than it is long."""
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
        """Cost, and among equal costs the number of steps."""
        return sum(each.cost * (length + 1) + 1 for each in steps)
