"""The cycle that keeps a plan from having a policy, in words."""

from cellwright.engine.model.uncertain_times import (
    CycleEdge,
    DerivedBound,
    EdgeKind,
    NegativeCycle,
    UncertainNetwork,
)
from cellwright.engine.pipelines.planning.robustness.plan_network import PlanNetwork


def cycle_lines(made: PlanNetwork, cycle: NegativeCycle) -> tuple[tuple[str, ...], int]:
    """What does not go together, each thing once, and how much time is lacking."""
    reading = _CycleReader(made, cycle)
    for wait in cycle.waits:
        reading.follow(wait)
    for edge in cycle.edges:
        reading.add(edge)
    return tuple(dict.fromkeys(reading.lines)), max(1, -reading.length)


class _CycleReader:
    def __init__(self, made: PlanNetwork, cycle: NegativeCycle) -> None:
        self.network: UncertainNetwork = made.network
        self.unit, self.cycle = made.unit, cycle
        self.names = [f"{step.id} {step.operator}" for step in made.varying]
        self.lines: list[str] = []
        self.length = 0

    def follow(self, bound: DerivedBound) -> None:
        """A path to the end of a link, which may take as long as it can."""
        for edge in bound.path:
            self.add(edge)
        most = self.network.links[bound.link].most
        self._say(f"{self.names[bound.link]} may last {most} {self.unit}", -most)

    def add(self, edge: CycleEdge) -> None:
        """One edge; those that are derived with all that they come from."""
        match edge.kind:
            case EdgeKind.BOUND:
                bound = self.network.bounds[edge.number]
                self._say(bound.says, bound.most)
            case EdgeKind.SHORTEST:
                least = self.network.links[edge.number].least
                self._say(f"{self.names[edge.number]} may last only {least} {self.unit}", least)
            case EdgeKind.AT_LEAST:
                least = self.network.links[edge.number].least
                self._say(f"{self.names[edge.number]} lasts at least {least} {self.unit}", -least)
            case _:
                self.follow(self.cycle.derived[edge.number])

    def _say(self, line: str, length: int) -> None:
        if line:
            self.lines.append(line)
        self.length += length
