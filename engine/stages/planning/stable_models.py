"""Plans as stable models (answer sets): horizon by horizon, and windows of a plan planned anew."""

import graphlib
from collections.abc import Iterator, Sequence
from functools import cached_property

from cellwright.engine.kernels.bits import Bits, indices
from cellwright.engine.model.ground_task import GroundOperator, GroundTask
from cellwright.engine.stages.planning.delete_relaxation import reachability_levels
from cellwright.engine.stages.planning.search_control import NO_PLAN, Effort, SearchResult
from cellwright.kb.asp.model_search import MultiShotSolver, Shown
from cellwright.kb.terms import Function, Number

STEP_PROGRAM = """
{ occurs(O,t) } :- first(O,L), L <= t.
:- occurs(O,t), needs(O,A), not holds(A,t-1).
added(A,t) :- occurs(O,t), adds(O,A).
deleted(A,t) :- occurs(O,t), deletes(O,A).
:- added(A,t), deleted(A,t).
holds(A,t) :- added(A,t).
holds(A,t) :- holds(A,t-1), not deleted(A,t).
:- group(G), 2 { holds(A,t) : member(G,A) }.
#heuristic holds(A,t-1) : holds(A,t). [1,true]
#heuristic holds(A,t-1) : not holds(A,t), fluent(A). [1,false]
#show occurs/2.
"""
PARALLEL_PROGRAM = """
:- used_up(A), 2 { occurs(O,t) : needs(O,A), deletes(O,A) }.
#edge ((operator(O),t),(kept(A),t)) : occurs(O,t), needs(O,A), not deletes(O,A).
#edge ((kept(A),t),(operator(O),t)) : occurs(O,t), deletes(O,A).
#edge ((operator(O),t),(left(A),t)) : occurs(O,t), needs(O,A), deletes(O,A).
#edge ((left(A),t),(operator(O),t)) : occurs(O,t), deletes(O,A), not needs(O,A).
"""
SINGLE_PROGRAM = """
:- 2 { occurs(O,t) }.
"""
CLINGO_OPTIONS = ("--heuristic=Domain", "--configuration=frumpy")


def task_facts(
    initial: Bits,
    operators: Sequence[GroundOperator],
    first: Sequence[int],
    groups: Sequence[Bits],
    size: int,
) -> Iterator[str]:
    """The facts of a task over atoms below `size`.

    `first` is the first step at which each operator can occur, -1 for never.
    """
    yield f"fluent(0..{max(size - 1, 0)})."
    yield "holds(A,0) :- initial(A)."
    yield from (f"initial({atom})." for atom in indices(initial))
    for number, group in enumerate(groups):
        yield f"group({number})."
        yield from (f"member({number},{atom})." for atom in indices(group))
    used = 0
    for number, operator in enumerate(operators):
        if first[number] < 0:
            continue
        deleted = operator.deletes & ~operator.adds
        yield f"first({number},{first[number]})."
        yield from (f"needs({number},{atom})." for atom in indices(operator.preconditions))
        yield from (f"adds({number},{atom})." for atom in indices(operator.adds))
        yield from (f"deletes({number},{atom})." for atom in indices(deleted))
        used |= operator.preconditions & deleted
    yield from (f"used_up({atom})." for atom in indices(used))


def occurring_sequence(
    operators: Sequence[GroundOperator], occurring: frozenset[tuple[int, ...]]
) -> list[GroundOperator]:
    """The operators of all pairs (number, step), ordered by step and within a step so that they
    can run.
    """
    steps: dict[int, list[GroundOperator]] = {}
    for number, step in sorted(occurring):
        steps.setdefault(step, []).append(operators[number])
    return [operator for step in sorted(steps) for operator in _order_together(steps[step])]


def _order_together(together: list[GroundOperator]) -> Iterator[GroundOperator]:
    sorter: graphlib.TopologicalSorter[int] = graphlib.TopologicalSorter(
        {number: () for number in range(len(together))}
    )
    for ending, ending_operator in enumerate(together):
        ended = ending_operator.deletes & ~ending_operator.adds
        for place, operator in enumerate(together):
            if place != ending and operator.preconditions & ended:
                sorter.add(ending, place)
    return (together[number] for number in sorter.static_order())


HORIZON_PROGRAM = """
#external asked(t).
reached(t) :- goal(G), holds(A,t) : wanted(G,A).
:- asked(t), not reached(t).
"""
DISTINCT_STATES_PROGRAM = """
#external distinct(t).
differ(S,t) :- holds(A,S), S < t, not holds(A,t).
differ(S,t) :- holds(A,t), S = 0..t-1, not holds(A,S).
:- distinct(t), S = 0..t-1, not differ(S,t).
:- distinct(t), 2 { occurs(O,t) }.
:- distinct(t), not 1 { occurs(O,t) }.
"""
# conflicts for one horizon in the first round; the number doubles in each round
TRIAL_CONFLICTS = 400
HORIZON_STRIDE = 5  # after an undecided horizon h the next is h + h // STRIDE
# atoms times pairs of states, up to which paths of different states are searched
MAX_PATH_ATOMS = 200_000


class HorizonSearch:
    """A search over growing horizons that can be resumed. With `single`, a step has one operator.

    The number of steps times the number of conditions and effects stays below `room`. Longer
    horizons are left undecided.
    """

    def __init__(
        self,
        task: GroundTask,
        operators: Sequence[GroundOperator],
        single: bool = False,
        room: int = 1 << 60,
    ) -> None:
        self._longest = room // max(sum(map(_operator_size, operators)), 1)
        self.operators, self.single, self.size = operators, single, len(task.atoms)
        reached, first = reachability_levels(task.initial, operators, self.size)
        nearest = [
            far for goal in task.goals if (far := _earliest_goal_step(goal, reached)) is not None
        ]
        self.possible = bool(nearest)
        # it is proved that no plan has this many steps or fewer
        self._decided = min(nearest, default=0) - 1
        self._task, self._first = task, first
        self._grounded, self._paths, self._trial = -1, 0, TRIAL_CONFLICTS

    @cached_property
    def _solver(self) -> MultiShotSolver:
        """The solver with all facts.

        It is made for the first horizon that has room, because the facts of a large task take much.
        """
        operators, size = self.operators, self.size
        base = [
            *task_facts(self._task.initial, operators, self._first, self._task.mutex_groups, size),
            *_goal_facts(self._task),
        ]
        return MultiShotSolver(
            {
                "base": ((), " ".join(base)),
                "step": (
                    ("t",),
                    STEP_PROGRAM + (SINGLE_PROGRAM if self.single else PARALLEL_PROGRAM),
                ),
                "ask": (("t",), HORIZON_PROGRAM),
                "distinct": (("t",), DISTINCT_STATES_PROGRAM),
            },
            CLINGO_OPTIONS,
        )

    def run(self, effort: Effort) -> SearchResult | None:
        """Searches until there is an answer or the effort is spent.

        The answer is a plan, or `NO_PLAN` if there is provably none. None means that the effort is
        spent.
        """
        if not self.possible:
            return NO_PLAN
        horizon = self._decided + 1
        while not effort.over() and self._decided < self._longest:
            answer = self._ask(horizon, effort)
            if isinstance(answer, frozenset):
                return SearchResult(occurring_sequence(self.operators, answer))
            if answer is False and horizon == self._decided + 1:
                self._decided = horizon
                if self._exhausted(horizon, effort):
                    return NO_PLAN
                horizon += 1
            elif self.single or horizon > 4 * (self._decided + 4) or horizon >= self._longest:
                horizon, self._trial = self._decided + 1, 2 * self._trial
            else:
                horizon = min(horizon + max(1, horizon // HORIZON_STRIDE), self._longest)
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
        if horizon < 1 or self.size * horizon * horizon > MAX_PATH_ATOMS or effort.over():
            return False
        while self._paths < horizon:
            self._paths += 1
            self._solver.ground([("distinct", (self._paths,))])
        paths = [Function("distinct", (Number(step),)) for step in range(1, horizon + 1)]
        return self._solve(paths, effort) is False

    def _solve(self, assumed: Sequence[Function], effort: Effort) -> Shown:
        conflicts_left = effort.limit - effort.expanded
        before = self._solver.conflicts
        answer = self._solver.solve(assumed, min(self._trial, conflicts_left), effort.interrupted)
        effort.expanded += min(1 + self._solver.conflicts - before, conflicts_left)
        return answer


def _operator_size(operator: GroundOperator) -> int:
    return sum(
        bits.bit_count() for bits in (operator.preconditions, operator.adds, operator.deletes)
    )


def _earliest_goal_step(goal: Bits, reached: Sequence[int]) -> int | None:
    """The first step after which every atom of a goal can be true; None if one of them never
    can.
    """
    steps = [reached[atom] for atom in indices(goal)]
    return None if -1 in steps else max(steps, default=0)


def _goal_facts(task: GroundTask) -> list[str]:
    texts = [f"goal({number})." for number in range(len(task.goals))]
    for number, goal in enumerate(task.goals):
        texts += [f"wanted({number},{atom})." for atom in indices(goal)]
    return texts


# up to this length the replacement has one step less; for longer windows about half
SHORT_WINDOW_STEPS = 12
BOUND_PROGRAM = """
:- #sum { C,O,T : occurs(O,T), weight(O,C) } >= b.
"""


class WindowReplanner:
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
            solver.ground(
                [("below", (self._weighed(window if best is None else best, len(window)),))]
            )
            before = solver.conflicts
            model = solver.solve((), self.conflicts - before, effort.interrupted)
            effort.generated += 1 + solver.conflicts - before
            if not isinstance(model, frozenset):
                break
            best = occurring_sequence(self.operators, model)
        return best

    def _solver(self, state: Bits, goals: Bits, length: int) -> MultiShotSolver | None:
        """The program of one window; None if the goals cannot be reached within the horizon."""
        horizon = (
            length - 1 if length <= SHORT_WINDOW_STEPS else max(SHORT_WINDOW_STEPS - 1, length // 2)
        )
        reached, first = reachability_levels(state, self.operators, self.size)
        if any(not 0 <= reached[atom] <= horizon for atom in indices(goals)):
            return None
        possible = [step if step <= horizon else -1 for step in first]
        text = [*task_facts(state, self.operators, possible, self.groups, self.size)]
        weights = (self._weighed([operator], length) for operator in self.operators)
        text += [f"weight({n},{w})." for n, w in enumerate(weights) if possible[n] >= 0]
        text += [f":- not holds({atom},{horizon})." for atom in indices(goals)]
        steps = [("step", (number,)) for number in range(1, horizon + 1)]
        parts = {
            "base": ((), " ".join(text)),
            "step": (("t",), STEP_PROGRAM + PARALLEL_PROGRAM),
            "below": (("b",), BOUND_PROGRAM),
        }
        solver = MultiShotSolver(parts, CLINGO_OPTIONS)
        solver.ground([("base", ()), *steps])
        return solver

    def _weighed(self, steps: Sequence[GroundOperator], length: int) -> int:
        """A number that compares by cost first, and by the number of steps if costs are equal."""
        return sum(step.cost * (length + 1) + 1 for step in steps)
