"""Reads circuits in the `.bench` format of the ISCAS-85 benchmarks (Brglez & Fujiwara 1985)."""

import re
from collections.abc import Mapping

from cellwright.engine.model.circuit import AND, OR, XOR, Circuit, Gate

_DECLARED = re.compile(r"(INPUT|OUTPUT)\s*\(\s*([^\s()]+)\s*\)", re.IGNORECASE)
_DRIVEN = re.compile(r"(\S+)\s*=\s*([A-Za-z]+)\s*\(([^()]*)\)")
_FUNCTIONS = {
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
        if declared := _DECLARED.fullmatch(line):
            (inputs if declared[1].upper() == "INPUT" else outputs).append(declared[2])
        elif driven := _DRIVEN.fullmatch(line):
            gates[driven[1]] = _gate(driven[2].upper(), driven[3], number)
        elif line:
            raise BenchError(f"line {number} is neither a declaration nor a gate: {line[:60]}")
    return Circuit(name, tuple(inputs), tuple(outputs), _ordered(gates, set(inputs)))


def _gate(function: str, inputs: str, number: int) -> Gate:
    if function not in _FUNCTIONS:
        raise BenchError(f"line {number}: unknown gate {function}")
    wires = tuple(each.strip() for each in inputs.split(",") if each.strip())
    if not wires:
        raise BenchError(f"line {number}: the gate has no inputs")
    kind, inverted = _FUNCTIONS[function]
    return Gate(kind, inverted, wires)


def _ordered(gates: Mapping[str, Gate], known: set[str]) -> dict[str, Gate]:
    """The gates, each after the gates that drive it.

    Raises `BenchError` if nothing drives a wire or gates form a cycle.
    """
    waiting = {name: len(set(gate.inputs) - known) for name, gate in gates.items()}
    readers: dict[str, list[str]] = {}
    for name, gate in gates.items():
        for wire in set(gate.inputs) - known:
            readers.setdefault(wire, []).append(name)
    ready, found = [name for name, count in waiting.items() if not count], {}
    for name in ready:  # the list grows during the loop
        found[name] = gates[name]
        for reader in readers.get(name, ()):
            waiting[reader] -= 1
            if not waiting[reader]:
                ready.append(reader)
    if len(found) < len(gates):
        stuck = next(name for name in gates if name not in found)
        raise BenchError(f"{stuck} depends on itself, or on a wire that nothing drives")
    return found
