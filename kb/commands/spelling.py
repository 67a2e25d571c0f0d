"""How words are spelt: numbers in words, and words that people join, such as "heater-shaker"."""

import re

_ONES = (
    "zero one two three four five six seven eight nine ten eleven twelve thirteen fourteen fifteen sixteen "
    "seventeen eighteen nineteen"
)
_DECADES = "twenty thirty forty fifty sixty seventy eighty ninety"
_SMALL, _TENS = _ONES.split(), _DECADES.split()
COUNTS = {word: value for value, word in enumerate(_SMALL)}
COUNTS |= {word: 10 * value for value, word in enumerate(_TENS, 2)}
COUNTS |= {f"{ten}-{one}": COUNTS[ten] + COUNTS[one] for ten in _TENS for one in _SMALL[1:10]}

_JOINED = re.compile(r"[^\W\d_]+(?:[-_][^\W\d_]+)+")
_NUMBERED = re.compile(r"[^\W\d_]+(?:[-_](?:[^\W\d_]+|\d{1,9}))+")


def parts(word: str, numbered: bool = False) -> tuple[str, ...]:
    """The words that a joined one consists of: "heater-shaker" and "heater_shaker" are "heater shaker"; numbers stay whole.

    With `numbered`, numbers may be among them: "oven_2" is "oven 2".
    """
    joined = (_NUMBERED if numbered else _JOINED).fullmatch(word) is not None and word.lower() not in COUNTS
    return tuple(re.split("[-_]", word)) if joined else (word,)


def with_article(noun: str) -> str:
    """The noun behind "a" or "an", as one hears it."""
    vowel = noun[0] in "aeiou" and not re.match(r"u[sn]i|u[st][ei]|eu|one", noun)
    return f"{'an' if vowel else 'a'} {noun}"
