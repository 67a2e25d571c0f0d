"""Fault knowledge of a kind of cell: exceptions, causes, tests and repairs.

Atoms may contain variables. The interrupted step binds those of its operator; any other variable
means "some".
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from cellwright.kb.diagnostics import NOWHERE, Source
from cellwright.kb.graphs import strong_components
from cellwright.kb.terms import ANYTHING, Atom, Function, Term


@dataclass(frozen=True, slots=True)
class Interruption:
    """An exception: a reply or a timeout that stops a plan, and how often each cause was found.

    `operator` is the operator whose command gets this answer; its variables stand for the step's
    arguments. None means any operator.
    """

    name: str
    say: str
    counts: Mapping[str, float]
    operator: Function | None = None
    reply: str = ""
    where: Source = field(default=NOWHERE, compare=False)


@dataclass(frozen=True, slots=True)
class Cause:
    """A fault. `doubts` are assertions that are uncertain while this cause is possible.

    If it is the cause, `denies` are removed from the world model, `adds` are added, and `loses` are
    resources that are lost. `completes` says that the interrupted step has done what it should.
    `stops` says that the cell cannot repair it: the cell stops safely and asks.

    `blocks` are steps that fail as long as the cause is there; None leaves that to
    `FaultModel.blocked`. `spoils` are facts and events: what earlier steps achieved of them is open
    again, back to the last step that is one of `since`.
    """

    name: str
    say: str
    doubts: tuple[Atom, ...] = ()
    adds: tuple[Atom, ...] = ()
    denies: tuple[Atom, ...] = ()
    loses: tuple[Term, ...] = ()
    stops: bool = False
    completes: bool = False
    blocks: tuple[Function, ...] | None = None
    spoils: tuple[Atom, ...] = ()
    since: tuple[Function, ...] = ()
    where: Source = field(default=NOWHERE, compare=False)


@dataclass(frozen=True, slots=True)
class FaultTest:
    """A test: `gives[cause][outcome]` is the probability of an outcome under a cause; others give
    `otherwise`.

    `by` is the step that carries it out. `asks` says whether it is a question to a person. Costs
    and durations are in the domain's unit of time. `repeats` is how often it can be done so that
    the outcomes are independent of each other given the cause; beyond that, and with 1, it gives
    the same outcome again.
    """

    name: str
    say: str
    cost: int
    outcomes: tuple[str, ...]
    otherwise: str
    gives: Mapping[str, Mapping[str, float]]
    preconditions: tuple[Atom, ...] = ()
    by: Function | None = None
    asks: bool = False
    duration: int = 0
    where: Source = field(default=NOWHERE, compare=False)
    repeats: int = 1

    def likelihood(self, outcome: str, cause: str) -> float:
        """The probability of an outcome under a cause."""
        given = self.gives.get(cause)
        if given is None:
            return float(outcome == self.otherwise)
        return given.get(outcome, 0.0)


@dataclass(frozen=True, slots=True)
class Repair:
    """A repair. `cures[cause]` is the probability that it removes a cause.

    If it does, `adds` and `denies` change the world, and `loses` are resources that stay lost: the
    repair is to go on without them. `by` is the step that carries it out, whether it helps or not.
    """

    name: str
    say: str
    cost: int
    cures: Mapping[str, float]
    preconditions: tuple[Atom, ...] = ()
    adds: tuple[Atom, ...] = ()
    denies: tuple[Atom, ...] = ()
    by: Function | None = None
    asks: bool = False
    duration: int = 0
    loses: tuple[Term, ...] = ()
    where: Source = field(default=NOWHERE, compare=False)


@dataclass(frozen=True, slots=True)
class FaultModel:
    """The fault base of a domain. Mappings keep the order of declaration.

    `smoothing` is added to every count. `stop` is the cost of a safe stop with a question. `lies`
    is the probability that an observation is wrong; it is used only if nothing else explains the
    observations.
    """

    domain: str
    exceptions: Mapping[str, Interruption]
    causes: Mapping[str, Cause]
    tests: Mapping[str, FaultTest]
    repairs: Mapping[str, Repair]
    smoothing: float = 1.0
    stop: int = 600
    lies: float = 0.01
    path: str = ""

    def duration(self, name: str) -> int:
        """How long a test or repair takes; 0 for any other name."""
        action = self.tests.get(name) or self.repairs.get(name)
        return action.duration if action else 0

    def repairs_of(self, cause: str) -> tuple[Repair, ...]:
        """The repairs that may remove a cause. The surest come first, then the cheapest."""
        serving = [repair for repair in self.repairs.values() if repair.cures.get(cause, 0.0) > 0.0]
        return tuple(sorted(serving, key=lambda repair: (-repair.cures[cause], repair.cost)))

    def blocked(self, cause: str, exception: str) -> tuple[Function, ...]:
        """The steps that fail as long as a cause is there, as patterns.

        Where a cause does not say it: none if it says what it changes in the world and the cell can
        go on, else the interrupted operator with whatever arguments.
        """
        entry, operator = self.causes[cause], self.exceptions[exception].operator
        if entry.blocks is not None:
            return entry.blocks
        if operator is None or (
            (entry.adds or entry.denies or entry.loses or entry.completes) and not entry.stops
        ):
            return ()
        return (Function(operator.name, (ANYTHING,) * len(operator.arguments)),)

    def priors(self, exception: str, counts: Mapping[str, float] | None = None) -> dict[str, float]:
        """The probability of each cause of an exception: (count + smoothing) over their sum
        (Laplace, Lidstone).
        """
        seen = self.exceptions[exception].counts if counts is None else counts
        causes = self.exceptions[exception].counts
        total = sum(seen.get(cause, 0.0) + self.smoothing for cause in causes)
        return {cause: (seen.get(cause, 0.0) + self.smoothing) / total for cause in causes}

    def telling(self, causes: Iterable[str]) -> tuple[FaultTest, ...]:
        """The tests that do not answer in the same way under all of these causes."""
        among = tuple(causes)
        return tuple(test for test in self.tests.values() if not _alike_causes(test, among))

    def alike(self, exception: str) -> list[tuple[str, ...]]:
        """The classes of causes of an exception that no test surely separates.

        Classes of one cause are left out.
        """
        order = tuple(self.exceptions[exception].counts)
        tests = (
            [[test.likelihood(o, c) for c in order] for o in test.outcomes]
            for test in self.tests.values()
        )
        return [
            tuple(order[index] for index in group)
            for group in inseparable_causes(tests, len(order))
        ]


def _alike_causes(test: FaultTest, causes: tuple[str, ...]) -> bool:
    rows = {tuple(test.likelihood(outcome, cause) for outcome in test.outcomes) for cause in causes}
    return len(rows) < 2


def inseparable_causes(
    tests: Iterable[Sequence[Sequence[float]]], count: int
) -> list[tuple[int, ...]]:
    """The classes of more than one of `count` causes, by their numbers, that no test surely
    separates.

    Of each test the probabilities of its outcomes are given (outcomes, causes). It surely separates
    two causes if each outcome rules out at least one of them. Causes that are not separated from
    the same one are in one class.
    """
    # for each cause, the set of those that nothing separates from it
    alike = [(1 << count) - 1] * count
    for rows in tests:
        possible = [
            sum(1 << cause for cause, chance in enumerate(row) if chance > 0.0) for row in rows
        ]
        for cause in range(count):
            shared = 0
            for causes in possible:
                shared |= causes if causes >> cause & 1 else 0
            alike[cause] &= shared | 1 << cause
    graph = {
        cause: [other for other in range(count) if near >> other & 1]
        for cause, near in enumerate(alike)
    }
    return sorted(tuple(sorted(group)) for group in strong_components(graph) if len(group) > 1)
