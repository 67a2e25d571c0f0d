"""A combinational circuit: its gates are ordered so that the inputs of a gate come before it."""

from collections.abc import Mapping
from dataclasses import dataclass

AND, OR, XOR = "and", "or", "xor"


@dataclass(frozen=True, slots=True)
class Gate:
    """A gate: a function of its inputs (`and`, `or`, `xor`), then inverted or not.

    With one input each function is the input.
    """

    function: str
    inverted: bool
    inputs: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Circuit:
    """A circuit. A wire has the name of its gate. `gates` is ordered from inputs to outputs."""

    name: str
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    gates: Mapping[str, Gate]

    def values(self, given: Mapping[str, bool], flipped: frozenset[str] = frozenset()) -> dict[str, bool]:
        """The value of every wire for given values of the inputs.

        The outputs of the gates in `flipped` are inverted.
        """
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
