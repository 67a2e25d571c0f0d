"""Derived atoms that are kept up to date, against those deduced from scratch."""

import random

from hypothesis import event, given, settings
from hypothesis import strategies as st

from cellwright.engine.kernels.axioms import Closure, Upkeep

FLUENTS, LAYERS, WIDE = 6, 4, 3
OTHERS = FLUENTS + LAYERS * WIDE  # the first complementary atom
SIZE = OTHERS + LAYERS * WIDE


@given(st.integers(0, 1 << 32))
@settings(max_examples=300, deadline=None)
def test_derived_atoms_kept_up_to_date_are_those_deduced_from_scratch(seed: int) -> None:
    """On random rules in layers, with recursion, and a random walk of states with stray derived
    atoms and bytes behind them.
    """
    chance = random.Random(seed)
    heads, bodies, layers = [], [], []
    for layer in range(LAYERS):
        first = FLUENTS + layer * WIDE
        readable = [*range(first + WIDE), *range(OTHERS, OTHERS + layer * WIDE)]
        for _ in range(chance.randint(0, 2 * WIDE)):
            heads.append(first + chance.randrange(WIDE))
            bodies.append(sorted(set(chance.choices(readable, k=chance.randint(0, 3)))))
            layers.append(layer)
    negated = [
        [(FLUENTS + each, OTHERS + each) for each in range(layer * WIDE, (layer + 1) * WIDE)]
        for layer in range(LAYERS)
    ]
    rules = (SIZE, heads, bodies, layers, negated, list(range(FLUENTS, SIZE)))
    closure, upkeep = Closure(*rules), Upkeep(*rules)
    state, seen = bytearray(chance.randbytes((SIZE + 7) // 8 + 2)), set()
    for _ in range(30):
        for atom in chance.sample(range(SIZE), chance.randint(0, 3)):
            state[atom >> 3] ^= 1 << (atom & 7)
        expected = closure.close(bytes(state))
        upkeep.complete(state)
        assert bytes(state) == expected
        seen.add(bytes(state))
    event("states differ" if len(seen) > 5 else "few states")
