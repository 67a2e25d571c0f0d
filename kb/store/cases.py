"""Closed cases in the same database as the MACROPs: the causes of each exception, and the cost of finding them."""

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from sqlalchemy import (
    Column,
    Float,
    Integer,
    MetaData,
    RowMapping,
    String,
    Table,
    Text,
    delete,
    func,
    select,
    update,
)

from cellwright.kb.json_text import parsed
from cellwright.kb.store.engines import MIGRATION, lock, refusal, transaction
from cellwright.kb.store.opening import Database

metadata = MetaData()
cases = Table(
    "fault_cases",
    metadata,
    Column("id", Integer, primary_key=True),
    Column("domain", String, nullable=False, index=True),
    Column("exception", String, nullable=False),
    Column("causes", Text, nullable=False),  # a JSON list, because several causes may be present at once
    Column(
        "weight", Float, nullable=False
    ),  # the number of cases that this row counts for; ageing reduces it
    Column("cost", Float, nullable=False),
    Column("observations", Text, nullable=False),  # a JSON list of [action, outcome]
)


@dataclass(frozen=True, slots=True)
class ClosedCase:
    """A finished case. `weight` is the number of cases that it counts for."""

    domain: str
    exception: str
    causes: tuple[str, ...]
    cost: float = 0.0
    observations: tuple[tuple[str, str], ...] = ()
    weight: float = 1.0


class Cases(Database):
    """The closed cases in a database, given by a file or a URL. Raises `InvalidInput` if the database reports an error."""

    def __init__(self, target: str) -> None:
        super().__init__(target, durable=True)
        with transaction(self._engine, target, writes=True) as connection:
            lock(connection, MIGRATION)
            metadata.create_all(connection)

    def add(self, closed: Iterable[ClosedCase]) -> None:
        """Store cases."""
        rows = [
            {
                "domain": each.domain,
                "exception": each.exception,
                "causes": json.dumps(each.causes),
                "weight": each.weight,
                "cost": each.cost,
                "observations": json.dumps(each.observations),
            }
            for each in closed
        ]
        if rows:
            with transaction(self._engine, self.target, writes=True, apart=len(rows) == 1) as connection:
                connection.execute(cases.insert(), rows)

    def history(self, domain: str, exception: str = "") -> tuple[ClosedCase, ...]:
        """The cases of a domain, or of one exception if it is named, the oldest first."""
        asked = select(cases).where(cases.c.domain == domain).order_by(cases.c.id)
        if exception:
            asked = asked.where(cases.c.exception == exception)
        with transaction(self._engine, self.target) as connection:
            rows = connection.execute(asked).mappings().all()
        try:
            return tuple(map(_closed, rows))
        except (ValueError, TypeError) as error:
            raise refusal(
                self.target,
                f"a closed case cannot be read: {error}",
                "`cellwright store check` says more",
                "K422",
            ) from error

    def discount(self, domain: str, factor: float) -> None:
        """Multiply the weight of every case of a domain by a factor."""
        changed = update(cases).where(cases.c.domain == domain).values(weight=cases.c.weight * factor)
        with transaction(self._engine, self.target, writes=True, apart=True) as connection:
            connection.execute(changed)

    def reset(self, domain: str) -> int:
        """Remove all cases of a domain; returns their number."""
        mine = cases.c.domain == domain
        with transaction(self._engine, self.target, writes=True) as connection:
            count = connection.execute(select(func.count()).where(mine)).scalar_one()
            connection.execute(delete(cases).where(mine))
        return int(count)


def _closed(row: RowMapping) -> ClosedCase:
    observations = tuple((action, outcome) for action, outcome in parsed(row["observations"]))
    return ClosedCase(
        row["domain"],
        row["exception"],
        tuple(parsed(row["causes"])),
        row["cost"],
        observations,
        row["weight"],
    )


def counts(given: Mapping[str, float], closed: Sequence[ClosedCase]) -> dict[str, float]:
    """The counts of a fault base plus those of closed cases. A case with several causes counts for each of them."""
    found = dict(given)
    for each in closed:
        for cause in each.causes:
            if cause in found:
                found[cause] += each.weight
    return found
