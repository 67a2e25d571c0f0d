"""A set of whole numbers from 0 on that takes an eighth of a byte for each: the steps of a long run that are done."""

from collections.abc import Iterable, Iterator, MutableSet


class NumberSet(MutableSet[int]):
    """A set of small whole numbers, as bits. It iterates in ascending order. Memory grows with the greatest number."""

    __slots__ = ("_bits", "_count")

    def __init__(self, numbers: Iterable[int] = ()) -> None:
        self._bits, self._count = bytearray(), 0
        for each in numbers:
            self.add(each)

    def __contains__(self, number: object) -> bool:
        if not isinstance(number, int) or not 0 <= number < 8 * len(self._bits):
            return False
        return bool(self._bits[number >> 3] >> (number & 7) & 1)

    def __iter__(self) -> Iterator[int]:
        for place, byte in enumerate(self._bits):
            if byte:
                yield from (8 * place + bit for bit in range(8) if byte >> bit & 1)

    def __len__(self) -> int:
        return self._count

    def add(self, value: int) -> None:
        """Add a number. Raises `ValueError` if it is negative."""
        if value < 0:
            raise ValueError(f"{value} is negative")
        if value not in self:
            missing = (value >> 3) + 1 - len(self._bits)
            self._bits.extend(bytes(max(0, missing)))
            self._bits[value >> 3] |= 1 << (value & 7)
            self._count += 1

    def discard(self, value: int) -> None:
        """Take a number out if it is in."""
        if value in self:
            self._bits[value >> 3] &= ~(1 << (value & 7))
            self._count -= 1
