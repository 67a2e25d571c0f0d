"""Counts of a library: uses of MACROPs, trials of composing, usefulness in searches.

These statements belong to each lookup. So they are made once: making one takes longer than the
answer of a server on the same machine.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from sqlalchemy import ColumnElement, Connection, Select, Table, bindparam, func, select
from sqlalchemy.dialects import postgresql, sqlite

from cellwright.kb.store.macrop_documents import Use
from cellwright.kb.store.table_schema import macrops, trials, usage, utility


def _holding_counts(*own: ColumnElement[bool]) -> Select[Any]:
    latest = select(macrops.c.fingerprint).where(*own).order_by(macrops.c.id.desc()).limit(1)
    return select(func.count(), func.max(macrops.c.id), latest.scalar_subquery()).where(*own)


_OF_DOMAIN = macrops.c.domain == bindparam("own")
_ALL, _FIRST = (
    _holding_counts(_OF_DOMAIN),
    _holding_counts(_OF_DOMAIN, macrops.c.id <= bindparam("last")),
)
_INCREASED_USES = {
    "uses": usage.c.uses + bindparam("times"),
    "lookup_s": usage.c.lookup_s + bindparam("seconds"),
}
_ADD_USE = usage.update().where(usage.c.macrop == bindparam("number")).values(_INCREASED_USES)


def library_holdings(
    connection: Connection, domain: str, last: int | None = None
) -> tuple[int, int, str]:
    """How many MACROPs of a domain there are, and number and fingerprint of the last; only
    those up to `last` if it is given.
    """
    asked, values = (
        (_ALL, {"own": domain}) if last is None else (_FIRST, {"own": domain, "last": last})
    )
    count, number, text = connection.execute(asked, values).one()
    return int(count), int(number or 0), str(text or "")


def add_uses(connection: Connection, uses: Mapping[int, Use]) -> None:
    """Add uses to MACROPs, by number."""
    rows = [
        {"number": number, "times": use.times, "seconds": use.lookup_s}
        for number, use in sorted(uses.items())
    ]
    if rows:
        connection.execute(_ADD_USE, rows if len(rows) > 1 else rows[0])


def add_trials(
    connection: Connection, domain: str, signature: str, successes: int, failures: int
) -> None:
    """Count attempts to compose plans for goals of one signature."""
    row = {"domain": domain, "signature": signature, "successes": successes, "failures": failures}
    connection.execute(_ADD_TRIAL[connection.dialect.name], row)


def _add_trial(insert: Callable[[Table], Any]) -> Any:
    made = insert(trials)
    more = {name: trials.c[name] + made.excluded[name] for name in ("successes", "failures")}
    return made.on_conflict_do_update(index_elements=["domain", "signature"], set_=more)


_ADD_TRIAL = {"sqlite": _add_trial(sqlite.insert), "postgresql": _add_trial(postgresql.insert)}


def trials_of(connection: Connection, domain: str, signature: str) -> tuple[int, int]:
    """How often plans for goals of one signature could be composed of MACROPs, and how often
    not.
    """
    row = connection.execute(_READ_TRIALS, {"own": domain, "goals": signature}).first()
    return (int(row[0]), int(row[1])) if row else (0, 0)


_READ_TRIALS = select(trials.c.successes, trials.c.failures).where(
    trials.c.domain == bindparam("own"), trials.c.signature == bindparam("goals")
)


RARELY, SELDOM = 8, 4  # after 8 offers, at least one in 4 must have been used
MAX_PAYING_SHARE = 0.85  # the largest share of the work without it that pays


@dataclass(frozen=True, slots=True)
class Utility:
    """The figures of one MACROP in one kind of search.

    Work is counted in generated nodes, summed over trials.
    """

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
        """Whether it should be offered: it saved work in trials, and is not too often offered
        without being used.
        """
        in_vain = self.offered >= RARELY and self.used * SELDOM < self.offered
        return self.beside < MAX_PAYING_SHARE * self.without and not in_vain

    @property
    def share(self) -> float:
        """The work with it, as a share of the work without it."""
        return self.beside / self.without if self.without else 1.0


UtilityFigures = Mapping[tuple[int, str], Utility]
"""Figures by the number of the MACROP and the kind of search."""


def figures_in(connection: Connection, domain: str = "") -> dict[tuple[int, str], Utility]:
    """All figures of a library, or those of one domain if it is named."""
    asked = select(utility).join_from(utility, macrops).order_by(utility.c.macrop, utility.c.search)
    if domain:
        asked = asked.where(macrops.c.domain == domain)
    rows = connection.execute(asked).all()
    return {(int(row[0]), str(row[1])): Utility(*map(int, row[2:])) for row in rows}


def add_figures(connection: Connection, more: UtilityFigures) -> None:
    """Add to the figures. Figures of removed MACROPs are dropped."""
    insert = sqlite.insert if connection.dialect.name == "sqlite" else postgresql.insert
    numbers = {number for number, _ in more}
    known = set(connection.scalars(select(macrops.c.id).where(macrops.c.id.in_(numbers))))
    for (number, search), figures in sorted(_of_known(more, known)):
        names = ("offered", "used", "trials", "without", "beside")
        values = {name: getattr(figures, name) for name in names}
        made = insert(utility).values(macrop=number, search=search, **values)
        added = {name: utility.c[name] + value for name, value in values.items()}
        connection.execute(
            made.on_conflict_do_update(index_elements=["macrop", "search"], set_=added)
        )


def _of_known(more: UtilityFigures, known: set[int]) -> Iterable[tuple[tuple[int, str], Utility]]:
    return [(key, figures) for key, figures in more.items() if key[0] in known]
