"""Lookup: the first MACROP of an index with an instance that serves a query and passes the check."""

import itertools
from collections.abc import Callable, Hashable
from dataclasses import dataclass

from engine.macros.checking import check
from engine.macros.index import Entry, Index
from engine.macros.instantiate import instantiate
from engine.macros.matching import OutOfWork, Work, matches
from engine.macros.query import Query, Situation
from engine.macros.schema import NotGeneral
from kb.model.macro import Macrop
from kb.model.plan import Plan

INSTANCES = 8  # of one MACROP that are checked before the next is tried


@dataclass(frozen=True, slots=True)
class Hit:
    """A checked instance: the plan, the MACROP it is of, and the situation that the plan leads to."""

    key: Hashable
    macrop: Macrop
    plan: Plan
    after: Situation


def look_up(
    index: Index, asked: Query, work: Work | None = None, in_vain: Callable[[Entry], None] = lambda _: None
) -> Hit | None:
    """A checked plan for a query from an index; None if no MACROP serves it, or none is found within `work`.

    `in_vain` hears of each MACROP that was tried and did not serve.
    """
    work = work if work is not None else Work()
    for entry in index.candidates(asked):
        try:
            hit = _instance(entry, asked, work)
        except OutOfWork:
            in_vain(entry)
            return None
        if hit is not None:
            return hit
        in_vain(entry)
    return None


def _instance(entry: Entry, asked: Query, work: Work) -> Hit | None:
    program = entry.program
    if program is None:
        return None
    for bindings in itertools.islice(matches(program, asked, work), INSTANCES):
        try:
            plan = instantiate(program.macrop, bindings)
        except NotGeneral:
            return None
        after = check(plan, asked)
        if isinstance(after, Situation):
            return Hit(entry.key, program.macrop, plan, after)
        if after.lost:
            return None
    return None
