"""Inspection data in the database: planned sequences, and arm poses for measurements.

No process waits while another one computes a sequence. A sequence is read, changed, and written
back only if it has not changed since it was read.
"""

import json
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from typing import Any

from sqlalchemy import bindparam, delete, insert, select
from sqlalchemy.dialects import postgresql, sqlite

from cellwright.kb.json_text import parse_json
from cellwright.kb.store.database import POSES, Database, lock_key, open_transaction, store_refusal
from cellwright.kb.store.macrop_outlines import row_chunks
from cellwright.kb.store.table_schema import poses, sequences


@dataclass(frozen=True, slots=True)
class PlannedVisit:
    """A planned visit: its tool, its position in metres, and its arm where several arms share
    the visits.
    """

    name: str
    tool: str
    position: tuple[float, ...]
    arm: str = ""


@dataclass(frozen=True, slots=True)
class SequencePlan:
    """The visits that are `done` and the `rest`, both in order.

    `lost` holds tools and resources that cannot be used any more. `bad` and `impossible` hold
    visits that are left out, with the reason. `changes` holds the costs of tool changes (tool,
    other tool, cost). `version` counts how often the plan was written.
    """

    domain: str
    problem: str
    done: tuple[PlannedVisit, ...] = ()
    rest: tuple[PlannedVisit, ...] = ()
    lost: tuple[str, ...] = ()
    bad: Mapping[str, str] = field(default_factory=dict)
    impossible: Mapping[str, str] = field(default_factory=dict)
    changes: tuple[tuple[str, str, int], ...] = ()
    version: int = 0


_KEPT_SEQUENCE = select(sequences.c.document, sequences.c.version).where(
    sequences.c.domain == bindparam("own"), sequences.c.problem == bindparam("whose")
)


class Sequences(Database):
    """The sequence plans in a database, given by a file or a URL.

    Raises `InvalidInput` if the database reports an error.
    """

    def __init__(self, target: str) -> None:
        super().__init__(target, durable=True)

    def of(self, domain: str, problem: str) -> SequencePlan | None:
        """The plan for a problem; None if none is stored."""
        with open_transaction(self._engine, self.target, apart=True) as connection:
            row = connection.execute(_KEPT_SEQUENCE, {"own": domain, "whose": problem}).first()
        if row is None:
            return None
        try:
            return _plan_from_document(domain, problem, parse_json(row[0]), row[1])
        except (ValueError, KeyError, TypeError, AttributeError) as error:
            said = f"the sequence of {problem} cannot be read: {error!r}"
            raise store_refusal(self.target, said, "give another file") from error

    def keep(self, plan: SequencePlan) -> bool:
        """Replace the version that a plan was made from.

        If that is not the last version, do nothing and return False.
        """
        row = {
            "domain": plan.domain,
            "problem": plan.problem,
            "version": plan.version + 1,
            "document": _plan_document(plan),
        }
        mine = (sequences.c.domain == plan.domain) & (sequences.c.problem == plan.problem)
        with open_transaction(self._engine, self.target, writes=True, apart=True) as connection:
            if plan.version:
                change = (
                    sequences.update()
                    .where(mine & (sequences.c.version == plan.version))
                    .values(**row)
                )
                return connection.execute(change).rowcount == 1
            insert = sqlite.insert if connection.dialect.name == "sqlite" else postgresql.insert
            made = (
                insert(sequences)
                .values(**row)
                .on_conflict_do_nothing()
                .returning(sequences.c.version)
            )
            return connection.execute(made).first() is not None


def _plan_document(plan: SequencePlan) -> str:
    content = {
        "done": [_visit_row(visit) for visit in plan.done],
        "rest": [_visit_row(visit) for visit in plan.rest],
        "lost": plan.lost,
        "bad": dict(plan.bad),
        "impossible": dict(plan.impossible),
        "changes": plan.changes,
    }
    return json.dumps(content, ensure_ascii=False)


def _visit_row(visit: PlannedVisit) -> list[Any]:
    """A visit as it is written; the arm is left out where there is one alone."""
    return [visit.name, visit.tool, visit.position, *([visit.arm] if visit.arm else [])]


def _plan_from_document(
    domain: str, problem: str, content: Mapping[str, Any], version: int
) -> SequencePlan:
    return SequencePlan(
        domain,
        problem,
        tuple(
            PlannedVisit(name, tool, tuple(at), *arm) for name, tool, at, *arm in content["done"]
        ),
        tuple(
            PlannedVisit(name, tool, tuple(at), *arm) for name, tool, at, *arm in content["rest"]
        ),
        tuple(content["lost"]),
        dict(content["bad"]),
        dict(content["impossible"]),
        tuple((a, b, cost) for a, b, cost in content["changes"]),
        version,
    )


Key = tuple[str, str, str]  # measurement, tool, station


class PoseStore(Database):
    """The kept poses in a database, given by a file or a URL.

    Raises `InvalidInput` if the database reports an error.
    """

    def of(self, domain: str, problem: str) -> dict[Key, str]:
        """The documents of a problem."""
        mine = (poses.c.domain == domain) & (poses.c.problem == problem)
        asked = select(poses.c.measurement, poses.c.tool, poses.c.station, poses.c.document).where(
            mine
        )
        with open_transaction(self._engine, self.target) as connection:
            return {(row[0], row[1], row[2]): row[3] for row in connection.execute(asked)}

    def keep(
        self,
        domain: str,
        problem: str,
        documents: Mapping[Key, str],
        measurements: Collection[str] | None = None,
    ) -> None:
        """Put documents in the place of all that are kept for a problem, or for some of its
        measurements.
        """
        mine = (poses.c.domain == domain) & (poses.c.problem == problem)
        some = [None] if measurements is None else row_chunks(sorted(measurements))
        rows = [
            {
                "domain": domain,
                "problem": problem,
                "measurement": m,
                "tool": t,
                "station": s,
                "document": text,
            }
            for (m, t, s), text in sorted(documents.items())
        ]
        with open_transaction(self._engine, self.target, writes=True) as connection:
            lock_key(connection, POSES)
            for names in some:
                own = mine if names is None else mine & poses.c.measurement.in_(names)
                connection.execute(delete(poses).where(own))
            if rows:
                connection.execute(insert(poses), rows)
