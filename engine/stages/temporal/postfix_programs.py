# cython: language_level=3, annotation_typing=False, boundscheck=False, wraparound=False
# cython: initializedcheck=False, cdivision=True
"""Arithmetic over the numbers of a state, as programs in postfix order.

The module is plain Python. Cython compiles it with the types in `postfix_programs.pxd`; without a
compiler it runs slowly.
"""

from array import array
from collections.abc import Sequence

from cellwright.engine.kernels.packed_rows import PackedRows


class PostfixPrograms:
    """Arithmetic in postfix order. Program i is an expression over the numbers of a state."""

    def __init__(
        self, programs: Sequence[Sequence[tuple[int, int]]], constants: Sequence[float]
    ) -> None:
        self.signs = PackedRows([[sign for sign, _ in each] for each in programs])
        self.values = PackedRows([[value for _, value in each] for each in programs])
        self.constants = array("d", [*constants, 0.0])
        self.stack = array("d", bytes(8 * (2 + max(map(len, programs), default=0))))

    def value(self, program: int, numbers: "array[float]") -> float:
        """The value of a program; not a number if it divides by 0 or reads what has no value."""
        size = 0
        for place in range(self.signs.starts[program], self.signs.starts[program + 1]):
            sign, index = self.signs.items[place], self.values.items[place]
            if sign == 0:
                self.stack[size] = self.constants[index]
                size += 1
            elif sign == 1:
                self.stack[size] = numbers[index]
                size += 1
            else:
                size -= 1
                self._calculate(sign, size)
        return self.stack[0]

    def _calculate(self, sign: int, size: int) -> None:
        one, two = self.stack[size - 1], self.stack[size]
        if sign == 2:
            self.stack[size - 1] = one + two
        elif sign == 3:
            self.stack[size - 1] = one - two
        elif sign == 4:
            self.stack[size - 1] = one * two
        elif two == 0:
            self.stack[size - 1] = self.constants[0]  # the first constant is not a number
        else:
            self.stack[size - 1] = one / two
