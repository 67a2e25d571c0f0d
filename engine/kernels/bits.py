# cython: language_level=3, annotation_typing=False, boundscheck=False, wraparound=False
"""Sets of atoms as integer bitsets (bit i is atom i), and the atoms in them.

Plain Python, compiled with the types in `bits.pxd`, because every stage of planning asks for the
atoms in a set.
"""

from collections.abc import Iterable

Bits = int


def indices(bits: Bits) -> list[int]:
    """The positions of the set bits, lowest first."""
    found = []
    row = bits.to_bytes((bits.bit_length() + 7) >> 3, "little")
    for place in range(len(row)):
        byte = row[place]
        position = place << 3
        while byte:
            if byte & 1:
                found.append(position)
            byte >>= 1
            position += 1
    return found


def bitset(positions: Iterable[int]) -> Bits:
    """The bitset of the given positions."""
    bits = 0
    for position in positions:
        bits |= 1 << position
    return bits
