"""Forward search: lazy greedy, with relaxed plans, landmarks, composites and short restarts.

They are instances of patterns whose steps are all in a state's relaxed plan. The relaxed plan shows
which of the many instances may help (Botea, Enzenberger, Müller & Schaeffer 2005). The other
instances are never made.
"""

import copy
import heapq
import itertools
from array import array
from collections.abc import Callable, Iterable, Sequence
from itertools import islice
from typing import NamedTuple

from cellwright.engine.kernels.bits import Bits
from cellwright.engine.model.ground_axioms import Axioms
from cellwright.engine.model.ground_task import GroundOperator, GroundTask
from cellwright.engine.model.outcome import MacroOffer
from cellwright.engine.stages.planning.composites import Pattern, PatternJoins, compose_operators
from cellwright.engine.stages.planning.forward.landmarks import LandmarkHints, Landmarks
from cellwright.engine.stages.planning.forward.packed_states import make_fronts
from cellwright.engine.stages.planning.forward.state_evaluation import StateEvaluation
from cellwright.engine.stages.planning.search_control import Effort, SearchResult, random_source
from cellwright.kb.terms import Function

MAX_SUGGESTED = 64  # the largest number of composites suggested for one state


class CompositeSuggestions:
    """The operators of a search, followed by every composite that was suggested so far."""

    def __init__(self, operators: Sequence[GroundOperator], patterns: Sequence[Pattern]) -> None:
        self.operators, self.patterns = list(operators), patterns
        self._plain = tuple(operators)
        self._joins = PatternJoins(self._plain, patterns)
        self._numbers: dict[tuple[int, ...], int | None] = {}
        self._sources: list[tuple[int, tuple[int, ...]]] = []

    def suggested(self, state: Bits, beginning: Iterable[int], relaxed: Sequence[int]) -> list[int]:
        """The numbers of the composites that a relaxed plan from `state` suggests, the longest
        first.

        `relaxed` are the operators of the relaxed plan; `beginning` are its applicable operators.
        """
        numbers: list[int] = []
        for pattern, parts in islice(self._joins.sequences(beginning, relaxed), MAX_SUGGESTED):
            number = self._numbered(pattern, parts)
            if number is not None and not self.operators[number].preconditions & ~state:
                numbers.append(number)
        return sorted(dict.fromkeys(numbers), key=lambda number: -len(self._source(number)[1]))

    def parts(self, number: int) -> Sequence[int]:
        """The numbers of the plain operators that a number stands for."""
        return (number,) if number < len(self._plain) else self._source(number)[1]

    def unfolded(self, number: int) -> list[GroundOperator]:
        """The operators that a number stands for."""
        return [self._plain[part] for part in self.parts(number)]

    def pattern(self, number: int) -> Pattern | None:
        """The pattern that a composite is an instance of; None for an ordinary operator."""
        return None if number < len(self._plain) else self.patterns[self._source(number)[0]]

    def _source(self, number: int) -> tuple[int, tuple[int, ...]]:
        return self._sources[number - len(self._plain)]

    def _numbered(self, pattern: int, parts: tuple[int, ...]) -> int | None:
        if parts not in self._numbers:
            operator = compose_operators([self._plain[part] for part in parts])
            self._numbers[parts] = None if operator is None else len(self.operators)
            if operator is not None:
                self.operators.append(operator)
                self._sources.append((pattern, parts))
        return self._numbers[parts]


UNKNOWN_ESTIMATE = 1 << 60
MAX_SMALL_NUMBER = (1 << 31) - 1  # of the numbers that an array of small ones holds
_MEETS_GOAL = Function("_meets")
PREFERRED = 1  # the queue of preferred operators, by relaxed plans
PREFERRED_BOOST = 1000  # turns that preferred operators get whenever the estimate improves


class ForwardNode(NamedTuple):
    """A packed state that was reached, the landmarks accepted on the way, and the step that led
    to it.
    """

    state: bytes
    accepted: bytes
    parent: int
    operator: int


class SuccessorBatch(NamedTuple):
    """Successors of one node that wait in a queue; the last one in `operators` is taken first.

    All have the estimate of the node, so they need only one entry in the queue. Most of them are
    never taken, and large tasks have hundreds for each node: so they are plain numbers without an
    object for each.
    """

    key: int
    tie: int
    node: int
    operators: "array[int]"


class ForwardSearch:
    """One search from a state to one conjunction of goals; it can be resumed.

    Operators may have conditional effects. A successor is the number of an operator; one that
    repeats an operator has as many times the number of all operators added.

    With hints for `landmarks`, additional queues are ordered by the number of landmarks that are
    left; they take turns with the queues ordered by relaxed plans. Then every operator counts as
    one step, because short plans are easier to find than cheap ones, and improvement makes them
    cheaper later. If all steps of an instance of `patterns` are in the relaxed plan of a state, the
    instance is used there as a preferred operator. With `joint` a step that serves many at once
    counts once in relaxed plans. Where a plan seems to cost `bound` or more, it is not followed;
    free steps count 1 there.
    """

    def __init__(
        self,
        operators: Sequence[GroundOperator],
        initial: Bits,
        goals: Bits,
        size: int,
        seed: int = 0,
        *,
        landmarks: LandmarkHints | None = None,
        joint: bool = False,
        bound: int = UNKNOWN_ESTIMATE,
        patterns: Sequence[Pattern] = (),
        axioms: Axioms | None = None,
    ) -> None:
        self._goals = goals
        self._suggestions = CompositeSuggestions(operators, patterns) if patterns else None
        self.operators = self._suggestions.operators if self._suggestions else operators
        self.evaluate = StateEvaluation(
            operators, goals, size, unit=landmarks is not None, joint=joint, axioms=axioms
        )
        self._space = self.evaluate.space
        self.initial = self._space.packed(initial)
        self._landmarks = self._found_landmarks(size, landmarks) if landmarks is not None else None
        self._given, self._axioms, self._bound = operators, axioms, bound
        self._begin(seed)

    def _begin(self, seed: int) -> None:
        """Nothing is searched yet."""
        self._counter = itertools.count()
        self._random = random_source(seed)
        self._queues: list[list[SuccessorBatch]] = [
            [] for _ in range(4)
        ]  # by relaxed plans: all, preferred; by landmarks: all, preferred
        self._priorities = [0] * 4
        self._nodes: list[ForwardNode] = []
        self._fronts = make_fronts(self._given, self._goals, self._axioms, self._space)
        self._best = [UNKNOWN_ESTIMATE, UNKNOWN_ESTIMATE]
        self._spent = list[int]()  # what each node cost, if there is a bound

    def again(self, seed: int) -> "ForwardSearch":
        """The same search from its beginning, with another seed.

        The two share what evaluates states, so they may take turns.
        """
        fresh = copy.copy(self)
        fresh._begin(seed)
        return fresh

    def _found_landmarks(self, size: int, hints: LandmarkHints) -> Landmarks:
        hidden = (1 << self.evaluate.size) - (1 << size)
        return Landmarks(
            self.evaluate.operators,
            self._space.atoms(self.initial),
            self._goals,
            self.evaluate.size,
            hidden,
            hints,
        )

    def run(self, effort: Effort) -> SearchResult | None:
        """Searches until there is an answer or the effort is spent.

        The answer is a plan, or `NO_PLAN` if there is provably none. None means that the effort is
        spent.
        """
        if (
            not self._nodes
            and not self._fronts.met(self.initial)
            and self._expand(self.initial, -1, -1, effort)
        ):
            return SearchResult([])
        while not effort.spent():
            entry = self._next()
            if entry is None:
                return self._space.exhausted()
            parent, operator = entry
            state, operator = self._reached(self._nodes[parent].state, operator)
            if (
                state
                and not self._fronts.met(state)
                and self._expand(state, parent, operator, effort)
            ):
                return self._answer()
        return None

    def _reached(self, state: bytes, number: int) -> tuple[bytes, int]:
        """The state after a successor's operator, and its number. A repeated operator ends where it
        is not applicable.

        The state is empty if it is left out.
        """
        if self._suggestions is not None:
            for part in self._suggestions.parts(number):
                state, _ = self._space.after(state, part)
            return state, number
        times, place = divmod(number, len(self.operators))
        state, done = self._space.after(state, place, max(times, 1))
        return state, place + (done * len(self.operators) if times else 0)

    def _next(self) -> tuple[int, int] | None:
        """The next successor to make, as (node, operator). None if all queues are empty."""
        number, least = -1, UNKNOWN_ESTIMATE
        for place, queue in enumerate(self._queues):
            if queue and self._priorities[place] < least:
                number, least = place, self._priorities[place]
        if number < 0:
            return None
        self._priorities[number] += 1
        batch = self._queues[number][0]
        operator = batch.operators.pop()
        if not batch.operators:
            heapq.heappop(self._queues[number])
        return batch.node, operator

    def _expand(self, state: bytes, parent: int, operator: int, effort: Effort) -> bool:
        """Evaluates a state and queues its successors.

        Returns whether the state satisfies the goals.
        """
        node_number = len(self._nodes)
        accepted = b""
        if self._landmarks:
            before = self._nodes[parent].accepted if parent >= 0 else self._landmarks.none
            accepted = self._landmarks.accept(before, state)
        self._nodes.append(ForwardNode(state, accepted, parent, operator))
        if self._goals & ~self._space.atoms(state) == 0:
            return True
        effort.expanded += 1
        estimate, applicable, preferred = self._evaluated(state)
        if self._is_dear(node_number, estimate) or estimate < 0:
            return False
        effort.generated += len(applicable)
        keys = [estimate, self._landmarks.left(accepted, state)] if self._landmarks else [estimate]
        if any(key < best for key, best in zip(keys, self._best, strict=False)):
            self._best = [min(pair) for pair in zip(keys, self._best, strict=False)]
            self._priorities[1] -= PREFERRED_BOOST
            self._priorities[3] -= PREFERRED_BOOST
        for place, key in enumerate(keys):
            for number, operators in ((2 * place, applicable), (2 * place + 1, preferred)):
                if operators:
                    rank = self._rank(key, node_number)
                    heapq.heappush(
                        self._queues[number],
                        SuccessorBatch(rank, self._tie(), node_number, in_order(operators)),
                    )
        return False

    def _rank(self, key: int, node: int) -> int:  # noqa: ARG002 - other searches rank by what the way cost, too
        """The place of a node's successors in a queue, by what seems to be left."""
        return key

    def _is_dear(self, node: int, estimate: int) -> bool:
        """Whether the way to the last node and on from there seems to reach the bound."""
        if self._bound == UNKNOWN_ESTIMATE:
            return False
        _, _, parent, operator = self._nodes[node]
        spent = 0
        if parent >= 0:
            times, place = divmod(operator, len(self.operators))
            spent = self._spent[parent] + max(times, 1) * max(self.operators[place].cost, 1)
        self._spent.append(spent)
        return spent + estimate >= self._bound

    def _evaluated(self, state: bytes) -> tuple[int, list[int], list[int]]:
        """A state's estimate, its applicable operators and its preferred ones.

        Suggested composites are in both lists.
        """
        estimate, applicable, preferred = self.evaluate(state)
        if estimate >= 0 and (jumps := self.evaluate.jumps):
            preferred = [
                *(place + times * len(self.operators) for place, times in jumps),
                *preferred,
            ]
        if self._suggestions is None or estimate < 0:
            return estimate, applicable, preferred
        composites = self._suggestions.suggested(
            self._space.atoms(state), preferred, self.evaluate.relaxed
        )
        return estimate, composites + applicable, composites + preferred

    def _tie(self) -> int:
        """The rank among equal keys: first in, first out; with a seed, by chance."""
        return self._random.getrandbits(30) if self._random else next(self._counter)

    def _answer(self) -> SearchResult:
        """The operators that led to the last state. Composites are replaced by their parts."""
        path, node = [], self._nodes[-1]
        while node.parent >= 0:
            path.append(node.operator)
            node = self._nodes[node.parent]
        path.reverse()
        if self._suggestions is None:
            return plan_of_path(self.operators, path)
        steps = [step for number in path for step in self._suggestions.unfolded(number)]
        used = [
            pattern for number in path if (pattern := self._suggestions.pattern(number)) is not None
        ]
        offer = MacroOffer("forward", tuple(self._suggestions.patterns), tuple(dict.fromkeys(used)))
        return SearchResult([step for step in steps if step.instance != _MEETS_GOAL], offer)


def in_order(operators: list[int]) -> "array[int]":
    """Numbers of operators, the last one first.

    Those of operators that are repeated may be large.
    """
    backward = operators[::-1]
    return array("i" if max(operators) <= MAX_SMALL_NUMBER else "q", backward)


def plan_of_path(operators: Sequence[GroundOperator], path: Sequence[int]) -> SearchResult:
    """The plan of successors on the way to the goal: numbers of operators, with that of all
    operators for each time they are done.
    """
    pairs = [divmod(number, len(operators)) for number in path]
    steps = [operators[place] for times, place in pairs for _ in range(max(times, 1))]
    return SearchResult([step for step in steps if step.instance != _MEETS_GOAL])


def with_one_goal(task: GroundTask) -> tuple[Sequence[GroundOperator], Bits, int]:
    """Operators, the only goal, and the number of atoms.

    If the goals have several alternatives, a new atom becomes the goal. For each alternative there
    is an internal operator that adds this atom.
    """
    size = len(task.atoms)
    if len(task.goals) == 1:
        return task.operators, task.goals[0], size
    task.reserve(size)
    meet = (GroundOperator(_MEETS_GOAL, goal, 1 << size, 0, cost=0) for goal in task.goals)
    return (*task.operators, *meet), 1 << size, size + 1


def start_forward_search(
    task: GroundTask, seed: int, *, landmarks: bool = False, patterns: Sequence[Pattern] = ()
) -> ForwardSearch:
    """The search for a task."""
    operators, goal, size = with_one_goal(task)
    return ForwardSearch(
        operators,
        task.initial,
        goal,
        size,
        seed,
        landmarks=LandmarkHints.of(task) if landmarks else None,
        patterns=() if task.axioms else patterns,
        axioms=task.axioms,
    )


SHORTEST_RUN_EXPANSIONS = 500  # expansions


class RestartingSearch:
    """Runs of several searches in turn; each run begins anew. It can be resumed."""

    def __init__(self, searches: Sequence[Callable[[], ForwardSearch]], seed: int = 0) -> None:
        self._searches, self._seed = searches, seed
        self._runs = self._left = 0
        self._search: ForwardSearch | None = None

    def run(self, effort: Effort) -> SearchResult | None:
        """Searches until there is an answer or the effort is spent, which is None."""
        while not effort.spent():
            search = self._search if self._search is not None and self._left > 0 else self._again()
            part = effort.part(self._left)
            answer = search.run(part)
            self._left -= part.expanded - effort.expanded
            effort.add(part)
            if answer is not None:
                return answer
        return None

    def _again(self) -> ForwardSearch:
        """The next run."""
        self._runs += 1
        self._left = SHORTEST_RUN_EXPANSIONS * luby_number(self._runs)
        search = self._searches[self._runs % len(self._searches)]()
        self._search = search.again(self._seed * 1_000_003 + self._runs)
        return self._search


def luby_number(number: int) -> int:
    """1, 1, 2, 1, 1, 2, 4, 1, 1, 2, 1, 1, 2, 4, 8 and so on, from number 1 on."""
    power = number.bit_length()
    return (
        1 << power - 1 if number == (1 << power) - 1 else luby_number(number - (1 << power - 1) + 1)
    )
