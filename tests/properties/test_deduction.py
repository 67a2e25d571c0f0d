"""The engine's deductive closure equals the closure that clingo computes from the same rules."""

from hypothesis import assume, given, settings
from hypothesis import strategies as st

from cellwright.engine.kernels.bits import Bits, bitset, indices
from cellwright.engine.stages.grounding.atom_deduction import Deduction
from cellwright.kb.asp import Grounder

SIZE = 6
MASKS = st.lists(st.integers(0, 2**SIZE - 1), min_size=SIZE, max_size=SIZE)


def transitively(direct: list[Bits]) -> tuple[Bits, ...]:
    """Each atom with all that it implies, by repetition until nothing changes."""
    closed = [1 << atom | mask for atom, mask in enumerate(direct)]
    for _ in range(SIZE):
        closed = [bitset([o for i in indices(mask) for o in indices(closed[i])]) for mask in closed]
    return tuple(closed)


def clingo_closure(
    adds: Bits,
    before: Bits,
    deletes: Bits,
    implies: list[Bits],
    denies: list[Bits],
    then: list[Bits],
    ends: list[Bits],
) -> tuple[Bits, Bits]:
    rules = [
        "add(B) :- add(A), implies(A,B).",
        "del(B) :- add(A), denies(A,B).",
        "gone(A) :- del(A), before(A).",
    ]
    rules += [
        "gone(A) :- deleted(A), before(A).",
        "add(B) :- gone(A), then(A,B).",
        "del(B) :- gone(A), ends(A,B).",
    ]
    tables = {"implies": implies, "denies": denies, "then": then, "ends": ends}
    sets = {"add": adds, "before": before, "deleted": deletes}
    rules += [
        f"{name}({a},{b})."
        for name, masks in tables.items()
        for a, mask in enumerate(masks)
        for b in indices(mask)
    ]
    rules += [f"{name}({a})." for name, mask in sets.items() for a in indices(mask)]
    rules += [f"#defined {name}/2." for name in tables] + [
        f"#defined {name}/1." for name in (*sets, "del", "gone")
    ]
    grounder = Grounder()
    grounder.ground("\n".join(rules))

    def bits(name: str) -> Bits:
        return bitset([int(str(row[0])) for row in grounder.atoms(name, 1)])

    return bits("add"), bits("del")


@given(
    st.integers(1, 2**SIZE - 1),
    st.integers(0, 2**SIZE - 1),
    st.integers(0, 2**SIZE - 1),
    MASKS,
    MASKS,
    MASKS,
    MASKS,
)
@settings(max_examples=100, deadline=None)
def test_the_closure_is_the_one_that_clingo_finds(
    adds: Bits,
    before: Bits,
    deletes: Bits,
    implies: list[Bits],
    denies: list[Bits],
    then: list[Bits],
    ends: list[Bits],
) -> None:
    sparse = [mask & (mask >> 1) for mask in implies], [mask & (mask >> 1) for mask in then]
    implies, then = sparse
    closed = transitively(implies)
    denied = tuple(
        bitset([o for i in indices(mask) for o in indices(denies[i])]) for mask in closed
    )
    deduction = Deduction(closed, denied, tuple(then), tuple(ends))
    assume(adds)
    assert deduction.close(adds, before, deletes) == clingo_closure(
        adds, before, deletes, implies, denies, then, ends
    )
