"""Sequence plans in the same database as the MACROPs: what was visited, what comes next, and what is left out and why.

Nobody waits while another process sequences: a sequence is read, changed and written back only if it is still the one
that was read.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import TracebackType
from typing import Any

from sqlalchemy import select
from sqlalchemy.dialects import postgresql, sqlite

from kb.store.engines import refusal, transaction
from kb.store.opening import opened
from kb.store.schema import sequences


@dataclass(frozen=True, slots=True)
class PlannedVisit:
    """A visit as it was planned: by which tool, and where (metres)."""

    name: str
    tool: str
    position: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class SequencePlan:
    """The visits that are `done` and the `rest`, both in order.

    `lost` are tools and resources that are not there any more; `bad` and `impossible` are visits left out, with the
    reason. `changes` is what a change of tools costs (tool, other tool, cost), `version` counts how often the plan was
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


class Sequences:
    """The sequence plans of a database, a file or a URL. Raises `InvalidInput` where it refuses."""

    def __init__(self, target: str) -> None:
        self.target = target
        self._engine = opened(target)

    def __enter__(self) -> "Sequences":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._engine.dispose()

    def of(self, domain: str, problem: str) -> SequencePlan | None:
        """The plan for a problem; None if none is kept."""
        mine = (sequences.c.domain == domain) & (sequences.c.problem == problem)
        with transaction(self._engine, self.target) as connection:
            row = connection.execute(select(sequences.c.document, sequences.c.version).where(mine)).first()
        if row is None:
            return None
        try:
            return _plan(domain, problem, json.loads(row[0]), row[1])
        except (ValueError, KeyError, TypeError, AttributeError) as error:
            said = f"the sequence of {problem} cannot be read: {error!r}"
            raise refusal(self.target, said, "give another file") from error

    def keep(self, plan: SequencePlan) -> bool:
        """Write a plan in place of the version that it was made from; False, and nothing done, if that is not the last."""
        row = {
            "domain": plan.domain,
            "problem": plan.problem,
            "version": plan.version + 1,
            "document": _document(plan),
        }
        mine = (sequences.c.domain == plan.domain) & (sequences.c.problem == plan.problem)
        with transaction(self._engine, self.target, writes=True) as connection:
            if plan.version:
                change = sequences.update().where(mine & (sequences.c.version == plan.version)).values(**row)
                return connection.execute(change).rowcount == 1
            insert = sqlite.insert if connection.dialect.name == "sqlite" else postgresql.insert
            made = insert(sequences).values(**row).on_conflict_do_nothing().returning(sequences.c.version)
            return connection.execute(made).first() is not None


def _document(plan: SequencePlan) -> str:
    content = {
        "done": [[each.name, each.tool, each.position] for each in plan.done],
        "rest": [[each.name, each.tool, each.position] for each in plan.rest],
        "lost": plan.lost,
        "bad": dict(plan.bad),
        "impossible": dict(plan.impossible),
        "changes": plan.changes,
    }
    return json.dumps(content, ensure_ascii=False)


def _plan(domain: str, problem: str, content: Mapping[str, Any], version: int) -> SequencePlan:
    return SequencePlan(
        domain,
        problem,
        tuple(PlannedVisit(name, tool, tuple(at)) for name, tool, at in content["done"]),
        tuple(PlannedVisit(name, tool, tuple(at)) for name, tool, at in content["rest"]),
        tuple(content["lost"]),
        dict(content["bad"]),
        dict(content["impossible"]),
        tuple((a, b, cost) for a, b, cost in content["changes"]),
        version,
    )
