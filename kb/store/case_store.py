"""Closed cases of troubleshooting in the database: causes of each exception, and their cost."""

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

from cellwright.kb.json_text import parse_json
from cellwright.kb.store.database import (
    MIGRATION,
    Database,
    lock_key,
    open_transaction,
    store_refusal,
)

metadata = MetaData()
cases = Table(
    "fault_cases",
    metadata,
    Column("id", Integer, primary_key=True),
    Column("domain", String, nullable=False, index=True),
    Column("exception", String, nullable=False),
    # a JSON list, because several causes may be present at once
    Column("causes", Text, nullable=False),
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
    """The closed cases in a database, given by a file or a URL.

    Raises `InvalidInput` if the database reports an error.
    """

    def __init__(self, target: str) -> None:
        super().__init__(target, durable=True)
        with open_transaction(self._engine, target, writes=True) as connection:
            lock_key(connection, MIGRATION)
            metadata.create_all(connection)

    def add(self, closed: Iterable[ClosedCase]) -> None:
        """Store cases."""
        rows = [
            {
                "domain": closed_case.domain,
                "exception": closed_case.exception,
                "causes": json.dumps(closed_case.causes),
                "weight": closed_case.weight,
                "cost": closed_case.cost,
                "observations": json.dumps(closed_case.observations),
            }
            for closed_case in closed
        ]
        if rows:
            with open_transaction(
                self._engine, self.target, writes=True, apart=len(rows) == 1
            ) as connection:
                connection.execute(cases.insert(), rows)

    def history(self, domain: str, exception: str = "") -> tuple[ClosedCase, ...]:
        """The cases of a domain, or of one exception if it is named, the oldest first."""
        asked = select(cases).where(cases.c.domain == domain).order_by(cases.c.id)
        if exception:
            asked = asked.where(cases.c.exception == exception)
        with open_transaction(self._engine, self.target) as connection:
            rows = connection.execute(asked).mappings().all()
        try:
            return tuple(map(_case_from_row, rows))
        except (ValueError, TypeError) as error:
            raise store_refusal(
                self.target,
                f"a closed case cannot be read: {error}",
                "`cellwright store check` says more",
                "K422",
            ) from error

    def discount(self, domain: str, factor: float) -> None:
        """Multiply the weight of every case of a domain by a factor."""
        changed = (
            update(cases).where(cases.c.domain == domain).values(weight=cases.c.weight * factor)
        )
        with open_transaction(self._engine, self.target, writes=True, apart=True) as connection:
            connection.execute(changed)

    def reset(self, domain: str) -> int:
        """Remove all cases of a domain; returns their number."""
        mine = cases.c.domain == domain
        with open_transaction(self._engine, self.target, writes=True) as connection:
            count = connection.execute(select(func.count()).where(mine)).scalar_one()
            connection.execute(delete(cases).where(mine))
        return int(count)


def _case_from_row(row: RowMapping) -> ClosedCase:
    observations = tuple((action, outcome) for action, outcome in parse_json(row["observations"]))
    return ClosedCase(
        row["domain"],
        row["exception"],
        tuple(parse_json(row["causes"])),
        row["cost"],
        observations,
        row["weight"],
    )


def cause_counts(given: Mapping[str, float], closed: Sequence[ClosedCase]) -> dict[str, float]:
    """The counts of a fault base plus those of closed cases.

    A case with several causes counts for each of them.
    """
    case_counts = dict(given)
    for closed_case in closed:
        for cause in closed_case.causes:
            if cause in case_counts:
                case_counts[cause] += closed_case.weight
    return case_counts
