"""Minimum-cardinality diagnosis of circuits: the fewest gates whose inversion explains the outputs.

clingo finds the value of every wire and the fewest inversions that give the outputs seen. Faults are searched only in top-level gates. No other gate dominates these, that is, lies on all their ways to
the outputs. This is enough, because a faulty gate can be replaced by its dominator without more faults
(Siddiqi & Huang 2007; Metodi, Stern, Kalech & Codish 2014).
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from cellwright.engine.model.circuit import XOR, Circuit
from cellwright.kb.asp.optimum import best_models

_RULES = """
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
"""  # f(G): gate G is faulty. v(W): wire W is 1. raw(G): the function of G gives 1, before it is inverted (out)

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
    text = program(circuit, given, seen, candidates)
    for _, atoms in best_models(text, "faulty", 1, OPTIONS):
        order = [*circuit.inputs, *circuit.gates]
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


def program(
    circuit: Circuit, given: Mapping[str, bool], seen: Mapping[str, bool], candidates: frozenset[str]
) -> str:
    """The program whose best models are the smallest sets of faulty gates among the candidates."""
    return "\n".join([*_facts(circuit, given, seen, candidates), _RULES])


def _facts(
    circuit: Circuit, given: Mapping[str, bool], seen: Mapping[str, bool], candidates: frozenset[str]
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
            yield from (f"in({i}, {place}, {number[wire]})." for place, wire in enumerate(gate.inputs, 1))
        else:
            yield from (f"in({i}, {number[wire]})." for wire in dict.fromkeys(gate.inputs))
    for output in dict.fromkeys(circuit.outputs):
        yield f":- {'not ' if seen[output] else ''}v({number[output]})."
