"""Circuits in the ISCAS-85 `.bench` format, and the fewest faulty gates that explain outputs."""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from cellwright.engine.model.troubleshooting import AND, OR, XOR, Circuit, Gate
from cellwright.kb.asp.model_search import best_models

_DECLARATION = re.compile(r"(INPUT|OUTPUT)\s*\(\s*([^\s()]+)\s*\)", re.IGNORECASE)
_GATE_LINE = re.compile(r"(\S+)\s*=\s*([A-Za-z]+)\s*\(([^()]*)\)")
_GATE_FUNCTIONS = {
    "AND": (AND, False),
    "NAND": (AND, True),
    "OR": (OR, False),
    "NOR": (OR, True),
    "XOR": (XOR, False),
    "XNOR": (XOR, True),
    "NOT": (AND, True),
    "BUFF": (AND, False),
    "BUF": (AND, False),
}


class BenchError(ValueError):
    """A line that is not in the `.bench` format; the message names the line."""


def read_bench(text: str, name: str = "circuit") -> Circuit:
    """The circuit in a text. Raises `BenchError`."""
    inputs: list[str] = []
    outputs: list[str] = []
    gates: dict[str, Gate] = {}
    for number, raw in enumerate(text.splitlines(), 1):
        line = raw.partition("#")[0].strip()
        if declared := _DECLARATION.fullmatch(line):
            (inputs if declared[1].upper() == "INPUT" else outputs).append(declared[2])
        elif driven := _GATE_LINE.fullmatch(line):
            gates[driven[1]] = _read_gate(driven[2].upper(), driven[3], number)
        elif line:
            raise BenchError(f"line {number} is neither a declaration nor a gate: {line[:60]}")
    return Circuit(name, tuple(inputs), tuple(outputs), _order_gates(gates, set(inputs)))


def _read_gate(function: str, inputs: str, number: int) -> Gate:
    if function not in _GATE_FUNCTIONS:
        raise BenchError(f"line {number}: unknown gate {function}")
    wires = tuple(wire.strip() for wire in inputs.split(",") if wire.strip())
    if not wires:
        raise BenchError(f"line {number}: the gate has no inputs")
    kind, inverted = _GATE_FUNCTIONS[function]
    return Gate(kind, inverted, wires)


def _order_gates(gates: Mapping[str, Gate], known: set[str]) -> dict[str, Gate]:
    """The gates, each after the gates that drive it.

    Raises `BenchError` if nothing drives a wire or gates form a cycle.
    """
    waiting = {name: len(set(gate.inputs) - known) for name, gate in gates.items()}
    readers: dict[str, list[str]] = {}
    for name, gate in gates.items():
        for wire in set(gate.inputs) - known:
            readers.setdefault(wire, []).append(name)
    ready, ordered = [name for name, count in waiting.items() if not count], {}
    for name in ready:  # the list grows during the loop
        ordered[name] = gates[name]
        for reader in readers.get(name, ()):
            waiting[reader] -= 1
            if not waiting[reader]:
                ready.append(reader)
    if len(ordered) < len(gates):
        stuck = next(name for name in gates if name not in ordered)
        raise BenchError(f"{stuck} depends on itself, or on a wire that nothing drives")
    return ordered


# f(G): gate G is faulty. v(W): wire W is 1. raw(G): the function of G gives 1, before it is
# inverted (out).
_CIRCUIT_RULES = """
{ f(G) : top(G) }.
raw(G) :- g(G, and, _), v(I) : in(G, I).
raw(G) :- g(G, or, _), in(G, I), v(I).
odd(G, K) :- in(G, K, I), v(I), not odd(G, K-1).
odd(G, K) :- in(G, K, I), not v(I), odd(G, K-1).
raw(G) :- last(G, K), odd(G, K).
out(G) :- g(G, _, 0), raw(G).
out(G) :- g(G, _, 1), not raw(G).
v(G) :- out(G), not f(G).
v(G) :- f(G), not out(G).
faulty(g(G)) :- f(G).
:~ f(G). [1, G]
"""

SOLVER_OPTIONS = ("--opt-strategy=usc,oll,disjoint", "--configuration=jumpy", "--sat-prepro=2")


@dataclass(frozen=True, slots=True)
class CircuitDiagnosis:
    """Gates whose inversion explains the outputs. No smaller set does so."""

    gates: tuple[str, ...]
    candidates: int  # the number of gates in which faults were searched


def diagnose_circuit(
    circuit: Circuit, given: Mapping[str, bool], seen: Mapping[str, bool]
) -> CircuitDiagnosis | None:
    """The smallest explanation of outputs `seen` for inputs `given`; None if no set of gates
    explains them.
    """
    candidates = top_level(circuit)
    text = diagnosis_program(circuit, given, seen, candidates)
    for _, atoms in best_models(text, "faulty", 1, SOLVER_OPTIONS):
        order = [*circuit.inputs, *circuit.gates]
        return CircuitDiagnosis(
            tuple(order[int(str(atom.arguments[0]))] for atom in atoms), len(candidates)
        )
    return None


def top_level(circuit: Circuit) -> frozenset[str]:
    """The gates that no other gate dominates: no gate lies on all their ways to the outputs.

    One pass goes from the outputs to the inputs. The immediate dominator of a gate is the nearest
    common dominator of its readers (Cooper, Harvey & Kennedy 2001). The root is the world behind
    all outputs.
    """
    order = {name: place for place, name in enumerate(circuit.gates)}
    readers: dict[str, list[str]] = {}
    for name, gate in circuit.gates.items():
        for wire in set(gate.inputs):
            readers.setdefault(wire, []).append(name)
    dominator: dict[str, str | None] = {}
    outputs = set(circuit.outputs)
    for name in reversed(list(circuit.gates)):
        following = [reader for reader in readers.get(name, ()) if reader in dominator]
        if name in outputs:
            dominator[name] = None
        elif following:
            dominator[name] = _common_dominator(following, dominator, order)
    return frozenset(name for name, above in dominator.items() if above is None)


def _common_dominator(
    following: list[str], dominator: Mapping[str, str | None], order: Mapping[str, int]
) -> str | None:
    """The nearest gate that lies on all ways from these gates; None if there is none."""
    common: str | None = following[0]
    for gate in following[1:]:
        here: str | None = gate
        while common != here and common is not None and here is not None:
            if order[common] < order[here]:
                common = dominator[common]
            else:
                here = dominator[here]
        if common != here:
            return None
    return common


def diagnosis_program(
    circuit: Circuit,
    given: Mapping[str, bool],
    seen: Mapping[str, bool],
    candidates: frozenset[str],
) -> str:
    """The program whose best models are the smallest sets of faulty gates among the candidates."""
    return "\n".join([*_circuit_facts(circuit, given, seen, candidates), _CIRCUIT_RULES])


def _circuit_facts(
    circuit: Circuit,
    given: Mapping[str, bool],
    seen: Mapping[str, bool],
    candidates: frozenset[str],
) -> Iterator[str]:
    number = {name: place for place, name in enumerate([*circuit.inputs, *circuit.gates])}
    yield from (f"v({number[wire]})." for wire, value in given.items() if value and wire in number)
    for name, gate in circuit.gates.items():
        i = number[name]
        yield f"g({i}, {gate.function}, {int(gate.inverted)})."
        if name in candidates:
            yield f"top({i})."
        if gate.function == XOR:
            yield f"last({i}, {len(gate.inputs)})."
            yield from (
                f"in({i}, {place}, {number[wire]})." for place, wire in enumerate(gate.inputs, 1)
            )
        else:
            yield from (f"in({i}, {number[wire]})." for wire in dict.fromkeys(gate.inputs))
    for output in dict.fromkeys(circuit.outputs):
        yield f":- {'not ' if seen[output] else ''}v({number[output]})."
