"""Minimum-cardinality diagnosis of circuits: the fewest gates whose inversion explains the outputs.

The inputs are known, so every wire has a nominal value. The only question is which wires differ from it.
Faults are searched only in top-level gates. No other gate dominates these, that is, lies on all their ways to
the outputs. This is enough, because a faulty gate can be replaced by its dominator without more faults
(Siddiqi & Huang 2007; Metodi, Stern, Kalech & Codish 2014).
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from engine.model.circuit import AND, XOR, Circuit, Gate
from kb.asp.optimum import best_models

OPTIONS = ("--opt-strategy=usc,oll,disjoint", "--configuration=jumpy", "--sat-prepro=2")


@dataclass(frozen=True, slots=True)
class CircuitDiagnosis:
    """Gates whose inversion explains the outputs. No smaller set does so."""

    gates: tuple[str, ...]
    candidates: int  # the number of gates in which faults were searched


def diagnose(
    circuit: Circuit, given: Mapping[str, bool], seen: Mapping[str, bool]
) -> CircuitDiagnosis | None:
    """The smallest explanation of outputs `seen` for inputs `given`; None if no set of gates explains them."""
    candidates = top_level(circuit)
    program = "\n".join(_program(circuit, given, seen, candidates))
    for _, atoms in best_models(program, "faulty", 1, OPTIONS):
        order = list(circuit.gates)
        return CircuitDiagnosis(tuple(order[int(str(atom.arguments[0]))] for atom in atoms), len(candidates))
    return None


def top_level(circuit: Circuit) -> frozenset[str]:
    """The gates that no other gate dominates: no gate lies on all their ways to the outputs.

    One pass goes from the outputs to the inputs. The immediate dominator of a gate is the nearest common
    dominator of its readers (Cooper, Harvey & Kennedy 2001). The root is the world behind all outputs.
    """
    order = {name: place for place, name in enumerate(circuit.gates)}
    readers: dict[str, list[str]] = {}
    for name, gate in circuit.gates.items():
        for wire in set(gate.inputs):
            readers.setdefault(wire, []).append(name)
    dominator: dict[str, str | None] = {}
    outputs = set(circuit.outputs)
    for name in reversed(list(circuit.gates)):
        following = [each for each in readers.get(name, ()) if each in dominator]
        if name in outputs:
            dominator[name] = None
        elif following:
            dominator[name] = _common(following, dominator, order)
    return frozenset(name for name, above in dominator.items() if above is None)


def _common(
    following: list[str], dominator: Mapping[str, str | None], order: Mapping[str, int]
) -> str | None:
    """The nearest gate that lies on all ways from these gates; None if there is none."""
    found: str | None = following[0]
    for other in following[1:]:
        here: str | None = other
        while found != here and found is not None and here is not None:
            if order[found] < order[here]:
                found = dominator[found]
            else:
                here = dominator[here]
        if found != here:
            return None
    return found


def _program(
    circuit: Circuit, given: Mapping[str, bool], seen: Mapping[str, bool], candidates: frozenset[str]
) -> Iterator[str]:
    """d(i): wire i differs from its nominal value. c(i): the inputs of its gate make it differ."""
    nominal = circuit.values(given)
    number = {name: place for place, name in enumerate(circuit.gates)}
    moving: set[str] = set()  # wires that some fault can make differ
    for name, gate in circuit.gates.items():
        inputs = [wire for wire in dict.fromkeys(gate.inputs) if wire in moving]
        rules = list(_rules(gate, nominal, moving, number)) if inputs else []
        head = "c" if name in candidates else "d"
        yield from (f"{head}({number[name]}) :- {body}." for body in rules)
        if name in candidates:
            i = number[name]
            yield f"{{f({i})}}. d({i}) :- f({i}), not c({i}). d({i}) :- c({i}), not f({i}). :~ f({i}). [1, {i}]"
            yield f"faulty(g({i})) :- f({i})."
        if name in candidates or rules:
            moving.add(name)
    for output in dict.fromkeys(circuit.outputs):
        differs = nominal[output] != seen[output]
        if output in moving:
            yield f":- {'not ' if differs else ''}d({number[output]})."
        elif differs:
            yield ":- not d(none)."  # the output is also an input, so no gate explains it


def _rules(
    gate: Gate, nominal: Mapping[str, bool], moving: set[str], number: Mapping[str, int]
) -> Iterator[str]:
    """Rule bodies: if one holds, the output of a gate differs because of its inputs."""
    if gate.function == XOR:
        yield from _odd(gate, moving, number)
        return
    strong = gate.function != AND  # one input with this value decides the output: 0 for `and`, 1 for `or`
    deciding = [wire for wire in dict.fromkeys(gate.inputs) if nominal[wire] == strong]
    others = [wire for wire in dict.fromkeys(gate.inputs) if nominal[wire] != strong and wire in moving]
    if not deciding:
        yield from (f"d({number[wire]})" for wire in others)
    elif all(wire in moving for wire in deciding):
        literals = [f"d({number[wire]})" for wire in deciding] + [f"not d({number[wire]})" for wire in others]
        yield ", ".join(literals)


def _odd(gate: Gate, moving: set[str], number: Mapping[str, int]) -> Iterator[str]:
    """Rule bodies that say that an odd number of inputs differ."""
    wires = [number[wire] for wire in gate.inputs if wire in moving]
    for chosen in range(1 << len(wires)):
        if bin(chosen).count("1") % 2:
            yield ", ".join(
                f"d({wire})" if chosen >> place & 1 else f"not d({wire})" for place, wire in enumerate(wires)
            )
