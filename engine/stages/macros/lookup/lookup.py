"""Lookup: the cheapest instance of a MACROP of an index that serves a query and passes the check."""

import itertools
from collections.abc import Callable, Hashable, Iterator, Mapping
from dataclasses import dataclass

from cellwright.engine.stages.macros.lifted.facts import Facts
from cellwright.engine.stages.macros.lifted.schema import NotGeneral
from cellwright.engine.stages.macros.lifted.situation import Situation
from cellwright.engine.stages.macros.lookup.checking import check
from cellwright.engine.stages.macros.lookup.index import Entry, Index
from cellwright.engine.stages.macros.lookup.instantiate import instantiate
from cellwright.engine.stages.macros.lookup.matching import MatchingBudget, OutOfWork, matches
from cellwright.engine.stages.macros.lookup.query import Query
from cellwright.kb.model.macro import Macrop
from cellwright.kb.model.plan import Plan
from cellwright.kb.terms import Term, Variable, is_ground, substitute_atom

INSTANCES = 8  # instances of one MACROP that are checked before the next MACROP is tried


@dataclass(frozen=True, slots=True)
class Hit:
    """A checked instance: the plan, its MACROP, and the situation after the plan."""

    key: Hashable
    macrop: Macrop
    plan: Plan
    after: Situation


def look_up(
    index: Index,
    asked: Query,
    work: MatchingBudget | None = None,
    in_vain: Callable[[Entry], None] = lambda _: None,
) -> Hit | None:
    """The cheapest checked plan for a query from an index; None if no MACROP serves it, or none is found within `work`.

    MACROPs come by their cost; those whose cost only a binding tells come last, and each of them is asked. `in_vain` hears
    of each MACROP that was tried and did not serve.
    """
    work = work if work is not None else MatchingBudget()
    best: Hit | None = None
    for entry in index.candidates(asked):
        if best is not None and entry.cost is not None and entry.cost >= best.plan.cost:
            continue
        try:
            hit = _cheapest(entry, asked, work)
        except OutOfWork:
            if best is None:
                in_vain(entry)
            return best
        if hit is None:
            in_vain(entry)
        elif best is None or hit.plan.cost < best.plan.cost:
            best = hit
    return best


def _cheapest(entry: Entry, asked: Query, work: MatchingBudget) -> Hit | None:
    """The cheapest instance of a MACROP; the first, if all cost the same."""
    hits = _instances(entry, asked, work)
    if entry.cost is not None:
        return next(hits, None)
    return min(hits, key=lambda hit: hit.plan.cost, default=None)


def _instances(entry: Entry, asked: Query, work: MatchingBudget) -> Iterator[Hit]:
    program = entry.program
    if program is None:
        return
    for bindings in itertools.islice(matches(program, asked, work), INSTANCES):
        if gives_up(program.macrop, bindings, asked):
            return
        try:
            plan = instantiate(program.macrop, bindings, asked.world.amounts)
        except NotGeneral:
            return
        after = check(plan, asked)
        if isinstance(after, Situation):
            yield Hit(entry.key, program.macrop, plan, after)
        elif after.lost:
            return


def gives_up(macrop: Macrop, bindings: Mapping[Variable, Term], asked: Query) -> bool:
    """Whether an instance ends a goal that held and does not achieve it again.

    Only its last steps are examined.

    False if the steps alone do not decide it.
    """
    open_ = {goal.atom for goal in asked.kept if goal.positive and is_ground(goal.atom)}
    statics = asked.world.statics
    for step in reversed(macrop.steps) if open_ else ():
        operator = substitute_atom(step.operator, bindings)
        known = asked.world.ground_step(operator) if is_ground(operator) else None
        if known is None or known.refusal:
            return False
        open_ -= set(known.adds)
        if not open_:
            return False
        if known.ended(Facts(open_), statics):
            return True
    return False
