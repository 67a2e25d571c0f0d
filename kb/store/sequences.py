"""Sequence plans in the same database as the MACROPs: visits that are done, visits that are left, and excluded visits.

No process waits while another one computes a sequence. A sequence is read, changed, and written back only if it has not
changed since it was read.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from sqlalchemy import bindparam, select
from sqlalchemy.dialects import postgresql, sqlite

from cellwright.kb.json_text import parsed
from cellwright.kb.store.engines import refusal, transaction
from cellwright.kb.store.opening import Database
from cellwright.kb.store.schema import sequences


@dataclass(frozen=True, slots=True)
class PlannedVisit:
    """A planned visit: its tool, its position in metres, and its arm where several arms share the visits."""

    name: str
    tool: str
    position: tuple[float, ...]
    arm: str = ""


@dataclass(frozen=True, slots=True)
class SequencePlan:
    """The visits that are `done` and the `rest`, both in order.

    `lost` holds tools and resources that cannot be used any more. `bad` and `impossible` hold visits that are left out, with
    the reason. `changes` holds the costs of tool changes (tool, other tool, cost). `version` counts how often the plan was
    written.
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


_KEPT = select(sequences.c.document, sequences.c.version).where(
    sequences.c.domain == bindparam("own"), sequences.c.problem == bindparam("whose")
)


class Sequences(Database):
    """The sequence plans in a database, given by a file or a URL. Raises `InvalidInput` if the database reports an error."""

    def __init__(self, target: str) -> None:
        super().__init__(target, durable=True)

    def of(self, domain: str, problem: str) -> SequencePlan | None:
        """The plan for a problem; None if none is stored."""
        with transaction(self._engine, self.target, apart=True) as connection:
            row = connection.execute(_KEPT, {"own": domain, "whose": problem}).first()
        if row is None:
            return None
        try:
            return _plan(domain, problem, parsed(row[0]), row[1])
        except (ValueError, KeyError, TypeError, AttributeError) as error:
            said = f"the sequence of {problem} cannot be read: {error!r}"
            raise refusal(self.target, said, "give another file") from error

    def keep(self, plan: SequencePlan) -> bool:
        """Replace the version that a plan was made from. If that is not the last version, do nothing and return False."""
        row = {
            "domain": plan.domain,
            "problem": plan.problem,
            "version": plan.version + 1,
            "document": _document(plan),
        }
        mine = (sequences.c.domain == plan.domain) & (sequences.c.problem == plan.problem)
        with transaction(self._engine, self.target, writes=True, apart=True) as connection:
            if plan.version:
                change = sequences.update().where(mine & (sequences.c.version == plan.version)).values(**row)
                return connection.execute(change).rowcount == 1
            insert = sqlite.insert if connection.dialect.name == "sqlite" else postgresql.insert
            made = insert(sequences).values(**row).on_conflict_do_nothing().returning(sequences.c.version)
            return connection.execute(made).first() is not None


def _document(plan: SequencePlan) -> str:
    content = {
        "done": [_row(each) for each in plan.done],
        "rest": [_row(each) for each in plan.rest],
        "lost": plan.lost,
        "bad": dict(plan.bad),
        "impossible": dict(plan.impossible),
        "changes": plan.changes,
    }
    return json.dumps(content, ensure_ascii=False)


def _row(visit: PlannedVisit) -> list[Any]:
    """A visit as it is written; the arm is left out where there is one alone."""
    return [visit.name, visit.tool, visit.position, *([visit.arm] if visit.arm else [])]


def _plan(domain: str, problem: str, content: Mapping[str, Any], version: int) -> SequencePlan:
    return SequencePlan(
        domain,
        problem,
        tuple(PlannedVisit(name, tool, tuple(at), *arm) for name, tool, at, *arm in content["done"]),
        tuple(PlannedVisit(name, tool, tuple(at), *arm) for name, tool, at, *arm in content["rest"]),
        tuple(content["lost"]),
        dict(content["bad"]),
        dict(content["impossible"]),
        tuple((a, b, cost) for a, b, cost in content["changes"]),
        version,
    )
