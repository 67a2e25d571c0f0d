"""Events in conditional effects: one step lets them happen to whatever is there, such as all tubes in a rotor.

Each is a conditional effect that moves the counter of its chain. An event that no chain waits for cannot occur, so the step
needs for each that its condition is false or its chain waits: this is a derived atom.
"""

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from cellwright.engine.kernels.bits import indices
from cellwright.engine.stages.grounding.derived import Rules
from cellwright.engine.stages.grounding.universe import Universe
from cellwright.engine.stages.grounding.workflow import Advance, Workflow
from cellwright.kb.terms import Atom, Function

Signed = tuple[int, ...]
Happening = tuple[Signed, Atom]


@dataclass
class Batches:
    """The events of each operator instance that happen under conditions. `rules` gets those of their derived atoms."""

    workflow: Workflow
    happening: Mapping[tuple[str, Signed], Sequence[Happening]]
    universe: Universe
    rules: Rules
    _allowed: dict[tuple[Atom, Signed], int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for found in self.happening.values():
            for conditions, event in found:
                self._allow(event, conditions)

    def conditions(self, operator: str, arguments: Signed) -> list[int]:
        """What an instance needs in addition, so that no event occurs that no chain waits for."""
        found = self.happening.get((operator, arguments), ())
        return list(dict.fromkeys(self._allowed[event, conditions] for conditions, event in found))

    def advances(self, operator: str, arguments: Signed) -> list[tuple[Signed, Advance]]:
        """How an instance moves which counter under which conditions. Of several chains that wait, the first one moves."""
        return [
            ((*conditions, *waiting), advance)
            for conditions, event in self.happening.get((operator, arguments), ())
            for waiting, advance in self._moves(event)
        ]

    def _moves(self, event: Atom) -> Iterator[tuple[Signed, Advance]]:
        """Each stage that an event is: what makes its chain the first one that waits, and how its counter moves."""
        earlier: list[Advance] = []
        stages = self.workflow.stages_of(event)
        for group in self.workflow.groups:
            own = [each for each in stages if each.adds & group]
            others = [[~atom for atom in indices(each.conditions)] for each in earlier]
            for each in own:
                for broken in itertools.product(*others):
                    yield (*indices(each.conditions), *dict.fromkeys(broken)), each
            earlier += own

    def _allow(self, event: Atom, conditions: Signed) -> None:
        if (event, conditions) in self._allowed:
            return
        number = self._allowed[event, conditions] = self.universe.derive(Function("_may", (event,)))
        stages = self.workflow.stages_of(event)
        bodies = [*((~each,) for each in conditions), *(tuple(indices(each.conditions)) for each in stages)]
        self.rules[number] = bodies
