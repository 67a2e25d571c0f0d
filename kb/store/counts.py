"""Counts in a library: its MACROPs, their uses, and trials of composing. The latter two are only increased, so any number of processes
may count at once.

These statements belong to each lookup. So they are made once: making one takes longer than the answer of a server on the same machine.
"""

from collections.abc import Callable, Mapping
from typing import Any

from sqlalchemy import ColumnElement, Connection, Select, Table, bindparam, func, select
from sqlalchemy.dialects import postgresql, sqlite

from cellwright.kb.store.records import Use
from cellwright.kb.store.schema import macrops, trials, usage


def _held(*own: ColumnElement[bool]) -> Select[Any]:
    latest = select(macrops.c.fingerprint).where(*own).order_by(macrops.c.id.desc()).limit(1)
    return select(func.count(), func.max(macrops.c.id), latest.scalar_subquery()).where(*own)


_OWN = macrops.c.domain == bindparam("own")
_ALL, _FIRST = _held(_OWN), _held(_OWN, macrops.c.id <= bindparam("last"))
_MORE = {"uses": usage.c.uses + bindparam("times"), "lookup_s": usage.c.lookup_s + bindparam("seconds")}
_USED = usage.update().where(usage.c.macrop == bindparam("number")).values(_MORE)


def holdings(connection: Connection, domain: str, last: int | None = None) -> tuple[int, int, str]:
    """How many MACROPs of a domain there are, and number and fingerprint of the last; only those up to `last` if it is given."""
    asked, values = (_ALL, {"own": domain}) if last is None else (_FIRST, {"own": domain, "last": last})
    count, number, text = connection.execute(asked, values).one()
    return int(count), int(number or 0), str(text or "")


def add_uses(connection: Connection, uses: Mapping[int, Use]) -> None:
    """Add uses to MACROPs, by number."""
    rows = [
        {"number": number, "times": use.times, "seconds": use.lookup_s}
        for number, use in sorted(uses.items())
    ]
    if rows:
        connection.execute(_USED, rows if len(rows) > 1 else rows[0])


def add_trials(connection: Connection, domain: str, signature: str, successes: int, failures: int) -> None:
    """Count attempts to compose plans for goals of one signature."""
    row = {"domain": domain, "signature": signature, "successes": successes, "failures": failures}
    connection.execute(_TRIED[connection.dialect.name], row)


def _tried(insert: Callable[[Table], Any]) -> Any:
    made = insert(trials)
    more = {name: trials.c[name] + made.excluded[name] for name in ("successes", "failures")}
    return made.on_conflict_do_update(index_elements=["domain", "signature"], set_=more)


_TRIED = {"sqlite": _tried(sqlite.insert), "postgresql": _tried(postgresql.insert)}


def trials_of(connection: Connection, domain: str, signature: str) -> tuple[int, int]:
    """How often plans for goals of one signature could be composed of MACROPs, and how often not."""
    row = connection.execute(_TRIALS, {"own": domain, "goals": signature}).first()
    return (int(row[0]), int(row[1])) if row else (0, 0)


_TRIALS = select(trials.c.successes, trials.c.failures).where(
    trials.c.domain == bindparam("own"), trials.c.signature == bindparam("goals")
)
