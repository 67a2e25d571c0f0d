# cython: language_level=3, annotation_typing=False, boundscheck=False, wraparound=False
# cython: initializedcheck=False, cdivision=True
"""The Mersenne Twister (Matsumoto & Nishimura 1998): the same random numbers as NumPy's
`RandomState`.

A seed gives the same numbers on every machine, compiled or not.
"""

import math
from array import array

SIZE, SHIFT = 624, 397
WORD, HIGH, LOW = 0xFFFFFFFF, 0x80000000, 0x7FFFFFFF
TWIST, TEMPER, TEMPER_HIGH = 0x9908B0DF, 0x9D2C5680, 0xEFC60000


class Stream:
    """The random numbers that follow from a seed. Only 32 bits of the seed count."""

    def __init__(self, seed: int) -> None:
        self.words = array("I", bytes(4 * SIZE))
        self._begin(seed & WORD)

    def random(self) -> float:
        """At least 0 and less than 1, with 53 random bits."""
        high = self._word() >> 5
        low = self._word() >> 6
        return (high * 67108864.0 + low) / 9007199254740992.0

    def below(self, count: int) -> int:
        """One of 0 .. count - 1. If there is only one, no random number is drawn."""
        if count <= 1:
            return 0
        mask = count - 1
        mask |= mask >> 1
        mask |= mask >> 2
        mask |= mask >> 4
        mask |= mask >> 8
        mask |= mask >> 16
        while True:
            found = self._word() & mask
            if found < count:
                return found

    def accepts(self, exponent: float) -> bool:
        """Whether a change is accepted that has the probability e to the power of `exponent`."""
        return self.random() < math.exp(exponent)

    def _begin(self, word: int) -> None:
        """The first words of the state."""
        for place in range(SIZE):
            self.words[place] = word
            word = (1812433253 * (word ^ (word >> 30)) + place + 1) & WORD
        self.place = SIZE

    def _word(self) -> int:
        """32 random bits."""
        if self.place == SIZE:
            self._turn()
        word = self.words[self.place]
        self.place += 1
        word ^= word >> 11
        word ^= (word << 7) & TEMPER
        word ^= (word << 15) & TEMPER_HIGH
        return word ^ (word >> 18)

    def _turn(self) -> None:
        """The next 624 words."""
        for place in range(SIZE):
            following = place + 1 if place + 1 < SIZE else 0
            far = place + SHIFT if place + SHIFT < SIZE else place + SHIFT - SIZE
            word = (self.words[place] & HIGH) | (self.words[following] & LOW)
            self.words[place] = self.words[far] ^ (word >> 1) ^ (TWIST * (word & 1))
        self.place = 0
