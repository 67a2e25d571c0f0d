"""Outlines of stored MACROPs: short rows that are read before any document.

Data that many MACROPs of a domain share (what they depend on, the conditions of the index) is
stored once, as a text with a number.
"""

import contextlib
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from sqlalchemy import Connection, select
from sqlalchemy.dialects import postgresql, sqlite

from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.json_text import parse_json
from cellwright.kb.store.database import store_refusal
from cellwright.kb.store.macrop_documents import Saving
from cellwright.kb.store.table_schema import macrops, outlines, shared, text_fingerprint, usage
from cellwright.kb.store.term_notation import Requirement

ROWS_PER_STATEMENT = 500  # the number of rows in one statement


@dataclass(frozen=True, slots=True)
class Outline(Saving):
    """A MACROP of a library without its document.

    `requirements` are the conditions of the index, each with its least number; None if they are not
    computed yet. MACROPs with the same `proof` depend on the same parts.
    """

    id: int
    signature: str
    name: str
    steps: int
    cost: int | None
    proof: int
    depends: Mapping[str, str]
    requirements: tuple[Requirement, ...] | None
    uses: int = 0
    planning_s: float = 0.0
    lookup_s: float = 0.0


class SharedTexts:
    """The shared texts of a library that were read so far, by number and by text."""

    def __init__(self) -> None:
        self._numbers: dict[str, int] = {}
        self._texts: dict[int, str] = {}
        self._depends: dict[int, Mapping[str, str]] = {}
        self._required: dict[str, Requirement] = {}

    def forget(self) -> None:
        """Forget all numbers, because an undone transaction may have given some of them."""
        self._numbers.clear()

    def numbers(self, connection: Connection, texts: Collection[str]) -> Mapping[str, int]:
        """The numbers of texts. New texts get new numbers."""
        new = {text_fingerprint(text): text for text in sorted(set(texts) - self._numbers.keys())}
        if new:
            insert = sqlite.insert if connection.dialect.name == "sqlite" else postgresql.insert
            rows = [{"fingerprint": digest, "text": text} for digest, text in new.items()]
            connection.execute(insert(shared).on_conflict_do_nothing(), rows)
            for chunk in row_chunks(sorted(new)):
                asked = select(shared.c.id, shared.c.fingerprint).where(
                    shared.c.fingerprint.in_(chunk)
                )
                self._numbers.update(
                    (new[digest], number) for number, digest in connection.execute(asked)
                )
        return self._numbers

    def outlines(self, connection: Connection, where: object) -> list[Outline]:
        """The outlines of MACROPs, by number."""
        columns = (macrops.c.id, macrops.c.signature, macrops.c.name, macrops.c.steps)
        figures = (usage.c.uses, usage.c.planning_s, usage.c.lookup_s)
        own = (outlines.c.cost, outlines.c.depends, outlines.c.requirements)
        asked = select(*columns, *own, *figures).join_from(macrops, outlines).outerjoin(usage)
        rows: list[tuple[Any, ...]] = [
            *connection.execute(asked.where(where).order_by(macrops.c.id))  # type: ignore[arg-type]
        ]
        with _damage_told():
            self._meet(connection, rows)
            return [self._outline(*row) for row in rows]

    def depends(
        self, connection: Connection, numbers: Iterable[int]
    ) -> dict[int, Mapping[str, str]]:
        """The parts that the proofs with these numbers depend on."""
        wanted = set(numbers)
        with _damage_told():
            self._read(connection, wanted - self._depends.keys())
            for number in wanted - self._depends.keys():
                self._depends[number] = _shared_parts(self._texts[number])
            return {number: self._depends[number] for number in wanted}

    def _meet(self, connection: Connection, rows: Collection[tuple[Any, ...]]) -> None:
        """Read the shared texts in the rows that were not read before."""
        words = {word for row in rows for word in (row[6] or "").split()} - self._required.keys()
        parsed = {word: tuple(map(int, f"{word}*1".split("*")[:2])) for word in words}
        self._read(connection, {number for number, _ in parsed.values()} - self._texts.keys())
        self._required.update(
            (word, (self._texts[number], least)) for word, (number, least) in parsed.items()
        )
        self.depends(connection, {row[5] for row in rows})

    def _read(self, connection: Connection, numbers: Collection[int]) -> None:
        for chunk in row_chunks(sorted(numbers)):
            asked = select(shared.c.id, shared.c.text).where(shared.c.id.in_(chunk))
            self._texts.update((number, text) for number, text in connection.execute(asked))

    def _outline(
        self,
        number: int,
        signature: str,
        name: str,
        steps: int,
        cost: int | None,
        proof: int,
        words: str | None,
        uses: int | None,
        planning_s: float | None,
        lookup_s: float | None,
    ) -> Outline:
        required = (
            tuple([self._required[word] for word in words.split()]) if words is not None else None
        )
        figures = uses or 0, planning_s or 0.0, lookup_s or 0.0
        return Outline(
            number, signature, name, steps, cost, proof, self._depends[proof], required, *figures
        )


def _shared_parts(text: str) -> Mapping[str, str]:
    """The parts in a shared text, with their digests. Raises `ValueError`."""
    parts = parse_json(text)
    if not isinstance(parts, dict):
        raise ValueError(f"this is not what a MACROP depends on: {text[:40]}")
    return parts


@contextlib.contextmanager
def _damage_told() -> Iterator[None]:
    """Turn what goes wrong with damaged rows into one refusal: a number that is none, a text of
    this number that is missing.
    """
    try:
        yield
    except KeyError as error:
        raise _damage_error(f"nothing is stored under {error}") from error
    except (ValueError, TypeError, AttributeError) as error:
        raise _damage_error(str(error)) from error


def _damage_error(why: str) -> InvalidInput:
    said = f"the outline of a MACROP cannot be read: {why[:120]}"
    return store_refusal("the library", said, "`cellwright store check` says more", "K422")


def words_of(requirements: Iterable[Requirement], numbers: Mapping[str, int]) -> str:
    """Requirements as text for a column: the numbers of their texts, each with its count if
    that is not one.
    """
    return " ".join(
        f"{numbers[text]}*{least}" if least != 1 else str(numbers[text])
        for text, least in requirements
    )


def row_chunks(values: list[Any]) -> Iterator[list[Any]]:
    """A list in pieces of a size that one statement can contain."""
    for start in range(0, len(values), ROWS_PER_STATEMENT):
        yield values[start : start + ROWS_PER_STATEMENT]
