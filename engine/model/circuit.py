"""A combinational circuit: gates in an order in which every input of a gate comes before it."""

from collections.abc import Mapping
from dataclasses import dataclass

AND, OR, XOR = "and", "or", "xor"


@dataclass(frozen=True, slots=True)
class Gate:
    """A gate: the function of its inputs (`and`, `or`, `xor`; of one input each is the input itself), then inverted or not."""

    function: str
    inverted: bool
    inputs: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Circuit:
    """Wires are named after the gate that drives them. `gates` is ordered from inputs to outputs."""

    name: str
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    gates: Mapping[str, Gate]

    def values(self, given: Mapping[str, bool], flipped: frozenset[str] = frozenset()) -> dict[str, bool]:
        """The value of every wire for values of the inputs, the outputs of the gates in `flipped` being inverted."""
        found = dict(given)
        for name, gate in self.gates.items():
            read = [found[wire] for wire in gate.inputs]
            value = (
                all(read)
                if gate.function == AND
                else any(read)
                if gate.function == OR
                else sum(read) % 2 == 1
            )
            found[name] = value ^ gate.inverted ^ (name in flipped)
        return found
