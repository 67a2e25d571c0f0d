"""The chain of a journal: each line carries a digest of itself and of the digest before it.

Whoever changes, exchanges, adds or leaves out a line would have to compute all digests behind it
again. The head is kept apart: a journal whose end was cut off does not reach it. A site can seal
the head with a key of its own (RFC 2104), which whoever has no key cannot compute again. This is
the chain of Haber and Stornetta (How to time-stamp a digital document, 1991) without its publisher.
"""

import hashlib
import hmac
import json
from collections.abc import Iterable, Iterator
from typing import NamedTuple

MAX_SHOWN_FINDINGS = 5  # of one journal


class StoredLine(NamedTuple):
    """One line as the database has it; `link` is its digest, None in a journal without a chain."""

    number: object
    at_ms: object
    kind: object
    content: object
    link: str | None


class ChainHead(NamedTuple):
    """The number and the digest of the last line of a journal, and the seal of both if a site has
    a key.
    """

    number: int
    link: str
    seal: str | None = None


def first_link(run: str, begun: str, document: str) -> str:
    """The digest before the first line: of what the run was begun with."""
    return _digest(run, begun, document)


def next_link(link: str, number: object, at_ms: object, kind: object, content: object) -> str:
    """The digest of a line behind another one."""
    return _digest(link, number, at_ms, kind, content)


def _digest(*parts: object) -> str:
    return hashlib.sha256(json.dumps(parts, default=repr).encode()).hexdigest()


def seal_of(key: bytes, run: str, head: ChainHead) -> str:
    """The seal of a head under a key."""
    said = json.dumps([run, head.number, head.link]).encode()
    return hmac.new(key, said, hashlib.sha256).hexdigest()


def chain_findings(first: str, stored: Iterable[StoredLine], head: ChainHead) -> Iterator[str]:
    """What does not fit in a journal that begins with the digest `first` and ends at its head.

    A line that does not fit is told once: the chain is followed on from what it carries.
    """
    link, number, told = first, 0, 0
    for line in stored:
        if told >= MAX_SHOWN_FINDINGS:
            yield "and more"
            return
        fits = next_link(link, *line[:4]) == line.link
        if isinstance(line.number, int) and line.number != number + 1:
            told += 1
            yield _missing(number, line.number)
        elif not fits:
            told += 1
            yield f"line {line.number} is not as it was written"
        number = line.number if isinstance(line.number, int) else number + 1
        link = line.link or ""
    if number < head.number:
        yield f"the end is missing: it has {number} lines, and {head.number} were written"
    elif (number, link) != (head.number, head.link) and not told:
        yield f"its end does not fit: it has {number} lines, and {head.number} were written"


def _missing(last: int, number: int) -> str:
    if number <= last:
        return f"line {number} stands behind line {last}"
    first = last + 1
    return (
        f"line {first} is missing"
        if number == first + 1
        else (f"lines {first} to {number - 1} are missing")
    )
