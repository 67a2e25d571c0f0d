"""Everyday wordings besides the phrases of a domain: "when done", "put them away", "heat it again
for 10 min".

Only a sentence that is not understood as it stands is said otherwise, and only if it is understood
then. What the phrases of a domain say themselves is never touched.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice

MAX_WAYS = 60  # ways to say one sentence that are tried

_END = r"(?=\s*(?:[,;.!]|\band\b|\bthen\b|$))"
_DONE = (
    r"(?:when|once|as\s+soon\s+as|after)\s+(?:(?:it|that|this|all|everything)\s+is\s+|(?:they|all)\s+are\s+)?"
    r"(?:done|finished|ready|complete|completed|over)\b"
)
_PREPOSITION = r"(?:for|in|into|inside|at|with|on|onto|to)\b"
_WAYS: tuple[tuple[re.Pattern[str], tuple[str, ...]], ...] = tuple(
    (re.compile(pattern, re.IGNORECASE), ways)
    for pattern, ways in (
        (rf"[,;]?\s*(?:\b(?:and|then)\b\s*)*({_DONE})\s*,\s*(?:then\s+)?", (", then ", "")),
        (rf"(?:[,;]|\band\b|,\s*and\b)\s*([^,;.]*?)\s+{_DONE}\s*\.?\s*$", (r", then \1",)),
        (rf"(?:[,;]|\band\b|,\s*and\b)\s*([^,;.]*?)\s+{_DONE}", (r", then \1",)),
        (rf"\s+{_DONE}\s*\.?\s*$", ("",)),
        (rf"\b(?:again|once\s+more)\s+(?={_PREPOSITION})", ("",)),
        (
            r"\b(then|and|,)\s+back\s+(?=(?:in|into|to)\b)",
            tuple(
                rf"\1 {verb} "
                for verb in ("put it back", "put them back", "bring it back", "bring them back")
            ),
        ),
        (
            r"\bput\s+away\s+([^,;.]+?)" + _END,
            (r"store \1", r"put \1 back", r"return \1", r"put back \1"),
        ),
        (
            r"\bput\s+([^,;.]+?)\s+away\b",
            (r"store \1", r"put \1 back", r"return \1", r"put back \1"),
        ),
        (r"\b(?:get|fetch|grab)\s+", ("take ", "pick up ", "grip ", "bring ")),
        (r"\b(?:preheat|anneal|warm\s+up|warm|bake)\s+", ("heat ", "process ")),
    )
)


@dataclass(frozen=True, slots=True)
class Saying:
    """A sentence said otherwise.

    `origins` has for each of its characters, and its end, the one of the original that it comes
    from.
    """

    text: str
    origins: tuple[int, ...]

    def original(self, offset: int) -> int:
        """The character of the original sentence at which this one has character `offset`."""
        return self.origins[min(offset, len(self.origins) - 1)]


def sayings(text: str) -> Iterator[Saying]:
    """Other ways to say a sentence, those with the fewest changes first."""
    yield from islice(_sayings(text), MAX_WAYS)


def _sayings(text: str) -> Iterator[Saying]:
    waiting, seen = [Saying(text, tuple(range(len(text) + 1)))], {text}
    while waiting:
        said = waiting.pop(0)
        for pattern, ways in _WAYS:
            for way in ways:
                for found in pattern.finditer(said.text):
                    other = _replaced(said, found, found.expand(way))
                    if other.text not in seen and len(seen) <= MAX_WAYS:
                        seen.add(other.text)
                        waiting.append(other)
                        yield other


def _replaced(said: Saying, found: re.Match[str], new: str) -> Saying:
    new = new if found.start() else re.sub(r"^,?\s*(?:then\s+)?", "", new)
    start, end = found.span()
    origins = (*said.origins[:start], *[said.origins[start]] * len(new), *said.origins[end:])
    return Saying(f"{said.text[:start]}{new}{said.text[end:]}", origins)


def swapping(text: str) -> int | None:
    """Where a sentence asks to swap things; None if it does not."""
    found = re.search(r"\b(?:swap|exchange)\b", text, re.IGNORECASE)
    return found.start() if found else None
