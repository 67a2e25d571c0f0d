"""Counts in a library: uses of MACROPs, and trials of composing. They are only increased, so any number of processes may count at once."""

from collections.abc import Mapping

from sqlalchemy import Connection, bindparam
from sqlalchemy.dialects import postgresql, sqlite

from kb.store.records import Use
from kb.store.schema import trials, usage


def add_uses(connection: Connection, uses: Mapping[int, Use]) -> None:
    """Add uses to MACROPs, by number."""
    more = {
        "uses": usage.c.uses + bindparam("times"),
        "lookup_s": usage.c.lookup_s + bindparam("seconds"),
    }
    rows = [
        {"number": number, "times": use.times, "seconds": use.lookup_s}
        for number, use in sorted(uses.items())
    ]
    if rows:
        connection.execute(usage.update().where(usage.c.macrop == bindparam("number")).values(more), rows)


def add_trials(connection: Connection, domain: str, signature: str, successes: int, failures: int) -> None:
    """Count attempts to compose plans for goals of one signature."""
    insert = sqlite.insert if connection.dialect.name == "sqlite" else postgresql.insert
    made = insert(trials).values(domain=domain, signature=signature, successes=successes, failures=failures)
    more = {"successes": trials.c.successes + successes, "failures": trials.c.failures + failures}
    connection.execute(made.on_conflict_do_update(index_elements=["domain", "signature"], set_=more))
