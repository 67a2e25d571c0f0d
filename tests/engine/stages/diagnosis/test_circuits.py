"""Diagnosis of circuits against brute force, and the reader of `.bench` files."""

import itertools

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from benchmarks.circuit_diagnosis import (
    BenchError,
    diagnose_circuit,
    read_bench,
    top_level,
)
from cellwright.engine.model.troubleshooting import AND, OR, XOR, Circuit, Gate

C17 = """# six gates
INPUT(1)
INPUT(2)
INPUT(3)
INPUT(6)
INPUT(7)
OUTPUT(22)
OUTPUT(23)
22 = NAND(10, 16)
23 = NAND(16, 19)
10 = NAND(1, 3)
11 = NAND(3, 6)
16 = NAND(2, 11)
19 = NAND(11, 7)
"""


@st.composite
def circuits(draw: st.DrawFn) -> Circuit:
    """Up to eight gates; every gate that nothing reads is an output."""
    inputs = tuple(f"i{n}" for n in range(draw(st.integers(1, 3))))
    gates: dict[str, Gate] = {}
    for number in range(draw(st.integers(1, 8))):
        wires = st.sampled_from([*inputs, *gates])
        read = tuple(draw(st.lists(wires, min_size=1, max_size=3)))
        gates[f"g{number}"] = Gate(draw(st.sampled_from((AND, OR, XOR))), draw(st.booleans()), read)
    used = {wire for gate in gates.values() for wire in gate.inputs}
    more = draw(st.sets(st.sampled_from(list(gates)), max_size=2))
    outputs = tuple(name for name in gates if name not in used or name in more)
    return Circuit("random", inputs, outputs, gates)


def fewest(circuit: Circuit, values: dict[str, bool], seen: dict[str, bool]) -> int | None:
    """The size of the smallest explanation, by trying all sets of gates."""
    for size in range(len(circuit.gates) + 1):
        for chosen in itertools.combinations(circuit.gates, size):
            found = circuit.values(values, frozenset(chosen))
            if all(found[output] == seen[output] for output in circuit.outputs):
                return size
    return None


@settings(max_examples=150, deadline=None)
@given(circuits(), st.data())
def test_no_fewer_gates_explain_the_outputs(circuit: Circuit, data: st.DataObject) -> None:
    values = {wire: data.draw(st.booleans()) for wire in circuit.inputs}
    seen = {output: data.draw(st.booleans()) for output in circuit.outputs}
    made, size = diagnose_circuit(circuit, values, seen), fewest(circuit, values, seen)
    assert (made is None) == (size is None)
    if made is not None:
        assert len(made.gates) == size
        found = circuit.values(values, frozenset(made.gates))
        assert all(found[output] == seen[output] for output in circuit.outputs)


@settings(max_examples=150, deadline=None)
@given(circuits())
def test_a_gate_is_top_level_if_no_other_stands_on_all_its_ways(circuit: Circuit) -> None:
    ways = {name: _ways(circuit, name) for name in circuit.gates}
    expected = {
        name for name, found in ways.items() if found and set.intersection(*found) == {name}
    }
    assert top_level(circuit) == expected


def _ways(circuit: Circuit, name: str) -> list[set[str]]:
    """The gates on each way from a gate to an output."""
    found = [{name}] if name in circuit.outputs else []
    for reader, gate in circuit.gates.items():
        if name in gate.inputs:
            found += [{name} | way for way in _ways(circuit, reader)]
    return found


@given(
    st.integers(0, 31),
    st.sets(st.sampled_from(["10", "11", "16", "19", "22", "23"]), min_size=1, max_size=3),
)
@settings(deadline=None)
def test_injected_inversions_bound_the_diagnosis(vector: int, flipped: set[str]) -> None:
    circuit = read_bench(C17)
    values = {wire: bool(vector >> place & 1) for place, wire in enumerate(circuit.inputs)}
    found = circuit.values(values, frozenset(flipped))
    seen = {output: found[output] for output in circuit.outputs}
    assume(any(seen[output] != circuit.values(values)[output] for output in seen))
    made = diagnose_circuit(circuit, values, seen)
    assert made is not None
    assert 1 <= len(made.gates) <= len(flipped)


def test_a_bench_file_is_read_in_any_order() -> None:
    circuit = read_bench(C17, "c17")
    assert circuit.inputs == ("1", "2", "3", "6", "7")
    assert circuit.outputs == ("22", "23")
    assert list(circuit.gates) == ["10", "11", "16", "19", "22", "23"]
    assert circuit.gates["22"] == Gate(AND, True, ("10", "16"))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("INPUT(1)\n2 = MAYBE(1)", "line 2: unknown gate MAYBE"),
        ("INPUT(1)\n2 = AND()", "line 2: the gate has no inputs"),
        ("INPUT(1)\nwires", "line 2 is neither"),
        ("INPUT(1)\n2 = AND(1, 3)\n3 = NOT(2)", "2 depends on itself"),
        ("2 = AND(1, 1)", "nothing drives"),
    ],
)
def test_what_is_no_bench_file_is_said(text: str, said: str) -> None:
    with pytest.raises(BenchError, match=said):
        read_bench(text)


@pytest.mark.parametrize(
    ("function", "table"),
    [
        ("AND", "0001"),
        ("NAND", "1110"),
        ("OR", "0111"),
        ("NOR", "1000"),
        ("XOR", "0110"),
        ("XNOR", "1001"),
        ("NOT", "10"),
        ("BUFF", "01"),
        ("BUF", "01"),
        ("Nand", "1110"),
    ],
)
def test_a_gate_computes_what_its_name_says(function: str, table: str) -> None:
    wires = ("a", "b")[: 1 if len(table) == 2 else 2]
    circuit = read_bench(
        f"input(a)\nInput( b )\n# note\nOUTPUT(z)  # note\nz = {function}({', '.join(wires)})"
    )
    found = [
        circuit.values({"a": False, "b": False} | dict(zip(wires, values, strict=True)))["z"]
        for values in itertools.product((False, True), repeat=len(wires))
    ]
    assert "".join(str(int(value)) for value in found) == table


def test_a_long_line_is_cut_in_the_message() -> None:
    with pytest.raises(BenchError) as raised:
        read_bench("w" * 70)
    assert str(raised.value).endswith(f": {'w' * 60}")


def test_no_gate_explains_an_output_that_is_also_an_input() -> None:
    circuit = Circuit("wire", ("a",), ("a", "g"), {"g": Gate(AND, True, ("a",))})
    assert diagnose_circuit(circuit, {"a": True}, {"a": False, "g": False}) is None
    made = diagnose_circuit(circuit, {"a": True}, {"a": True, "g": True})
    assert made is not None
    assert (made.gates, made.candidates) == (("g",), 1)


def test_a_gate_that_leads_to_no_output_is_not_blamed() -> None:
    gates = {
        "dead": Gate(AND, False, ("a",)),
        "more": Gate(OR, False, ("dead",)),
        "g": Gate(AND, True, ("a",)),
    }
    circuit = Circuit("dead", ("a",), ("g",), gates)
    assert top_level(circuit) == {"g"}
    made = diagnose_circuit(circuit, {"a": True}, {"g": True})
    assert made is not None
    assert made.gates == ("g",)
