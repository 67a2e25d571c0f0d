"""Goals that can be met in several ways, such as `measured(_, _, meas(m3))`.

If the ways of all conjuncts have few combinations, each combination becomes an alternative goal of the task.
If they have many, each conjunct gets an atom of its own, and internal operators add these atoms at the end:
`_ends` ends the plan proper, and `_meets(n, k)` says that conjunct n holds in its k-th way. Internal
operators cost nothing and never appear in a plan. Gazen & Knoblock 1997 compile disjunctive goals in this
way, too. Where derived atoms stay in the task, a conjunct that can be met in several ways is a derived atom itself.
"""

import itertools
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import prod

from cellwright.engine.model.stages import ENDS, MEETS
from cellwright.engine.model.task import Bits, GroundOperator, Task
from cellwright.engine.stages.grounding.derived import Rules, Support
from cellwright.engine.stages.grounding.numbering import Numbering
from cellwright.engine.stages.grounding.universe import Universe
from cellwright.kb.terms import Atom, Function, Number

MAX_ALTERNATIVES = 64
NO_STAGES: Mapping[str, int] = {}
RUNNING, ENDED = Function("_running"), Function("_ended")


@dataclass(frozen=True, slots=True)
class Counted:
    """A chain: the bit of each count of its stages, how many are reached at the start, and what has to hold at the end of
    each number of stages.
    """

    bits: tuple[Bits, ...]
    begun: int
    lasting: tuple[Bits, ...]


@dataclass(frozen=True, slots=True)
class Parted:
    """A ground task without goals, the ways to satisfy each conjunct of its problem's goal, and its chains by their names."""

    task: Task
    ways: tuple[tuple[Bits, ...], ...]
    chains: Mapping[str, "Counted"] = field(default_factory=dict)

    def wanting(
        self, parts: Sequence[int], stages: Mapping[str, int] = NO_STAGES, free: Collection[str] = ()
    ) -> Task | None:
        """The task with some of the conjuncts as its goal, and with chains up to so many `stages`.

        Those that are `free` may move and need not; the others do not move.

        None if there are too many combinations of the ways of conjuncts.
        """
        chosen = [self.ways[each] for each in parts]
        if prod(map(len, chosen)) > MAX_ALTERNATIVES:
            return None
        counts = {name: max(stages.get(name, 0), each.begun) for name, each in self.chains.items()}
        counts |= {name: len(self.chains[name].bits) - 1 for name in free}
        beyond = _union(b for name, each in self.chains.items() for b in each.bits[counts[name] + 1 :])
        ends = _union(self.chains[name].bits[counts[name]] for name in stages)
        ends |= _union(self.chains[name].lasting[number] for name, number in stages.items())
        goals = dict.fromkeys(ends | _union(choice) for choice in itertools.product(*chosen))
        operators = self.task.operators
        if beyond:
            operators = tuple(each for each in operators if not each.adds & beyond)
        return replace(self.task, operators=operators, goals=tuple(goals))


@dataclass
class Goals:
    """The ways to satisfy each conjunct of a goal. Additional atoms are numbered from `first` on."""

    parts: list[list[Support]]
    first: int
    atoms: list[Atom] = field(init=False)
    initial: Bits = field(init=False)

    def __post_init__(self) -> None:
        product = 1
        for part in self.parts:
            product = min(product * len(part), MAX_ALTERNATIVES + 1)
        self._open = [number for number, part in enumerate(self.parts) if len(part) != 1]
        self._many = product > MAX_ALTERNATIVES
        met = [Function("_met", (Number(number),)) for number in self._open]
        self.atoms = [RUNNING, ENDED, *met] if self._many else []
        self.initial = 1 << self.first if self._many else 0

    def compiled(
        self, operators: list[GroundOperator], numbering: Numbering
    ) -> tuple[list[Bits], list[GroundOperator]]:
        """The alternative goals, and the operators together with the internal ones."""
        if not self._many:
            found = {_joined(choice, numbering): None for choice in itertools.product(*self.parts)}
            return list(found), operators
        running, ended = 1 << self.first, 2 << self.first
        goal = ended | _joined([part[0] for part in self.parts if len(part) == 1], numbering)
        made = [replace(each, preconditions=each.preconditions | running) for each in operators]
        made.append(GroundOperator(Function(ENDS), running, ended, running, cost=0))
        for place, number in enumerate(self._open):
            met = 4 << self.first + place
            goal |= met
            for way, support in enumerate(self.parts[number]):
                name = Function(MEETS, (Number(number), Number(way)))
                made.append(GroundOperator(name, numbering.bits(support) | ended, met, 0, cost=0))
        return [goal], made


def layered(parts: Iterable[list[Support]], universe: Universe, rules: Rules) -> list[list[Support]]:
    """The conjuncts with one way each: what can be met in several ways is an additional derived atom with `rules`."""
    found = []
    for number, ways in enumerate(parts):
        if len(ways) > 1:
            met = universe.derive(Function("_met", (Number(number),)))
            rules[met] = [tuple(sorted(way)) for way in ways]
            ways = [frozenset([met])]
        found.append(ways)
    return found


def _joined(choice: Iterable[Support], numbering: Numbering) -> Bits:
    return _union(numbering.bits(support) for support in choice)


def _union(choice: Iterable[Bits]) -> Bits:
    joined = 0
    for each in choice:
        joined |= each
    return joined
