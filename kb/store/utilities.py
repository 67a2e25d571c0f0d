"""The usefulness of sub-sequences in searches: how often each was offered and used, and the work that it saved in trials.

Figures are only increased by additions, so that any number of processes may count at the same time.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from sqlalchemy import Connection, select
from sqlalchemy.dialects import postgresql, sqlite

from cellwright.kb.store.schema import macrops, utility

RARELY, SELDOM = 8, 4  # after 8 offers, at least one in 4 must have been used
PAYS = 0.85  # the largest share of the work without it that pays


@dataclass(frozen=True, slots=True)
class Utility:
    """The figures of one MACROP in one kind of search. Work is counted in generated nodes, summed over trials."""

    offered: int = 0
    used: int = 0
    trials: int = 0
    without: int = 0
    beside: int = 0

    def __add__(self, other: "Utility") -> "Utility":
        return Utility(
            self.offered + other.offered,
            self.used + other.used,
            self.trials + other.trials,
            self.without + other.without,
            self.beside + other.beside,
        )

    @property
    def pays(self) -> bool:
        """Whether it should be offered: it saved work in trials, and is not too often offered without being used."""
        in_vain = self.offered >= RARELY and self.used * SELDOM < self.offered
        return self.beside < PAYS * self.without and not in_vain

    @property
    def share(self) -> float:
        """The work with it, as a share of the work without it."""
        return self.beside / self.without if self.without else 1.0


Figures = Mapping[tuple[int, str], Utility]
"""Figures by the number of the MACROP and the kind of search."""


def figures_in(connection: Connection, domain: str = "") -> dict[tuple[int, str], Utility]:
    """All figures of a library, or those of one domain if it is named."""
    asked = select(utility).join_from(utility, macrops).order_by(utility.c.macrop, utility.c.search)
    if domain:
        asked = asked.where(macrops.c.domain == domain)
    rows = connection.execute(asked).all()
    return {(int(row[0]), str(row[1])): Utility(*map(int, row[2:])) for row in rows}


def add_figures(connection: Connection, more: Figures) -> None:
    """Add to the figures. Figures of removed MACROPs are dropped."""
    insert = sqlite.insert if connection.dialect.name == "sqlite" else postgresql.insert
    numbers = {number for number, _ in more}
    known = set(connection.scalars(select(macrops.c.id).where(macrops.c.id.in_(numbers))))
    for (number, search), each in sorted(_of_known(more, known)):
        names = ("offered", "used", "trials", "without", "beside")
        values = {name: getattr(each, name) for name in names}
        made = insert(utility).values(macrop=number, search=search, **values)
        added = {name: utility.c[name] + value for name, value in values.items()}
        connection.execute(made.on_conflict_do_update(index_elements=["macrop", "search"], set_=added))


def _of_known(more: Figures, known: set[int]) -> Iterable[tuple[tuple[int, str], Utility]]:
    return [(key, each) for key, each in more.items() if key[0] in known]
