"""Plans as stable models, horizon by horizon.

With one operator in a step, the first plan that is found has the fewest steps. There is no plan if every
reachable state lies within a horizon without a plan. This is the case when no path of that many steps from
the initial state visits only different states (Biere et al. 1999).
"""

from collections.abc import Sequence
from functools import cached_property

from cellwright.engine.model.task import Bits, GroundOperator, Task, indices
from cellwright.engine.stages.planning.effort import NO_PLAN, Effort, SearchResult
from cellwright.engine.stages.planning.relaxed import levels
from cellwright.engine.stages.planning.stable_models.encoding import (
    OPTIONS,
    PARALLEL,
    SINGLE,
    STEP,
    facts,
    sequence,
)
from cellwright.kb.asp.steps import Shown, Solver
from cellwright.kb.terms import Function, Number

ASK = """
#external asked(t).
reached(t) :- goal(G), holds(A,t) : wanted(G,A).
:- asked(t), not reached(t).
"""
DISTINCT = """
#external distinct(t).
differ(S,t) :- holds(A,S), S < t, not holds(A,t).
differ(S,t) :- holds(A,t), S = 0..t-1, not holds(A,S).
:- distinct(t), S = 0..t-1, not differ(S,t).
:- distinct(t), 2 { occurs(O,t) }.
:- distinct(t), not 1 { occurs(O,t) }.
"""
TRIAL = 400  # conflicts for one horizon in the first round; the number doubles in each round
STRIDE = 5  # after an undecided horizon h the next is h + h // STRIDE
PATHS = 200_000  # atoms times pairs of states, up to which paths of different states are searched


class Parallel:
    """A search over growing horizons that can be resumed. With `single`, a step has one operator.

    The number of steps times the number of conditions and effects stays below `room`. Longer horizons are
    left undecided.
    """

    def __init__(
        self, task: Task, operators: Sequence[GroundOperator], single: bool = False, room: int = 1 << 60
    ) -> None:
        self._longest = room // max(sum(map(_size, operators)), 1)
        self.operators, self.single, self.size = operators, single, len(task.atoms)
        reached, first = levels(task.initial, operators, self.size)
        nearest = [far for goal in task.goals if (far := _farthest(goal, reached)) is not None]
        self.possible = bool(nearest)
        self._decided = min(nearest, default=0) - 1  # it is proved that no plan has this many steps or fewer
        self._task, self._first = task, first
        self._grounded, self._paths, self._trial = -1, 0, TRIAL

    @cached_property
    def _solver(self) -> Solver:
        """The solver with all facts. It is made for the first horizon that has room, because the facts of a large task take much."""
        operators, size = self.operators, self.size
        base = [
            *facts(self._task.initial, operators, self._first, self._task.mutex_groups, size),
            *_goals(self._task),
        ]
        return Solver(
            {
                "base": ((), " ".join(base)),
                "step": (("t",), STEP + (SINGLE if self.single else PARALLEL)),
                "ask": (("t",), ASK),
                "distinct": (("t",), DISTINCT),
            },
            OPTIONS,
        )

    def run(self, effort: Effort) -> SearchResult | None:
        """Searches until there is an answer or the effort is spent.

        The answer is a plan, or `NO_PLAN` if there is provably none. None means that the effort is spent.
        """
        if not self.possible:
            return NO_PLAN
        horizon = self._decided + 1
        while not effort.over() and self._decided < self._longest:
            found = self._ask(horizon, effort)
            if isinstance(found, frozenset):
                return SearchResult(sequence(self.operators, found))
            if found is False and horizon == self._decided + 1:
                self._decided = horizon
                if self._exhausted(horizon, effort):
                    return NO_PLAN
                horizon += 1
            elif self.single or horizon > 4 * (self._decided + 4) or horizon >= self._longest:
                horizon, self._trial = self._decided + 1, 2 * self._trial
            else:
                horizon = min(horizon + max(1, horizon // STRIDE), self._longest)
        return None

    def _ask(self, horizon: int, effort: Effort) -> Shown:
        while self._grounded < horizon:
            self._grounded += 1
            step = ("step", (self._grounded,)) if self._grounded else ("base", ())
            self._solver.ground([step, ("ask", (self._grounded,))])
        return self._solve([Function("asked", (Number(horizon),))], effort)

    def _exhausted(self, horizon: int, effort: Effort) -> bool:
        """Whether no path of `horizon` steps visits only different states.

        If so, shorter paths reach every reachable state.
        """
        if horizon < 1 or self.size * horizon * horizon > PATHS or effort.over():
            return False
        while self._paths < horizon:
            self._paths += 1
            self._solver.ground([("distinct", (self._paths,))])
        paths = [Function("distinct", (Number(step),)) for step in range(1, horizon + 1)]
        return self._solve(paths, effort) is False

    def _solve(self, assumed: Sequence[Function], effort: Effort) -> Shown:
        left = effort.limit - effort.expanded
        before = self._solver.conflicts
        found = self._solver.solve(assumed, min(self._trial, left), effort.interrupted)
        effort.expanded += min(1 + self._solver.conflicts - before, left)
        return found


def _size(operator: GroundOperator) -> int:
    return sum(bits.bit_count() for bits in (operator.preconditions, operator.adds, operator.deletes))


def _farthest(goal: Bits, reached: Sequence[int]) -> int | None:
    """The first step after which every atom of a goal can be true; None if one of them never can."""
    found = [reached[atom] for atom in indices(goal)]
    return None if -1 in found else max(found, default=0)


def _goals(task: Task) -> list[str]:
    found = [f"goal({number})." for number in range(len(task.goals))]
    for number, goal in enumerate(task.goals):
        found += [f"wanted({number},{atom})." for atom in indices(goal)]
    return found
