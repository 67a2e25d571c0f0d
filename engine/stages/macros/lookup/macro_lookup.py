"""Lookup of the cheapest instance of a MACROP that serves a query, and the check of the
instance.
"""

import itertools
from collections.abc import Callable, Hashable, Iterator, Mapping
from dataclasses import dataclass

from cellwright.engine.stages.lifted.cell_domain import Situation
from cellwright.engine.stages.lifted.fact_queries import FactSet
from cellwright.engine.stages.lifted.operator_schemas import NotGeneral
from cellwright.engine.stages.macros.lookup.macro_index import IndexEntry, MacroIndex
from cellwright.engine.stages.macros.lookup.macro_instances import (
    check_instance,
    instantiate_macro,
)
from cellwright.engine.stages.macros.lookup.macro_matching import (
    MatchingBudget,
    OutOfWork,
    match_macro,
)
from cellwright.engine.stages.macros.lookup.macro_query import MacroQuery
from cellwright.engine.stages.macros.lookup.shortening import shortened
from cellwright.kb.model.plan_model import Macrop, Plan
from cellwright.kb.terms import (
    Term,
    Variable,
    is_ground,
    substitute_atom,
)

# instances of one MACROP that are checked before the next MACROP is tried
MAX_CHECKED_INSTANCES = 8


@dataclass(frozen=True, slots=True)
class LookupHit:
    """A checked instance: the plan, its MACROP, and the situation after the plan."""

    key: Hashable
    macrop: Macrop
    plan: Plan
    after: Situation


def look_up(
    index: MacroIndex,
    asked: MacroQuery,
    work: MatchingBudget | None = None,
    in_vain: Callable[[IndexEntry], None] = lambda _: None,
) -> LookupHit | None:
    """The cheapest checked plan for a query from an index; None if no MACROP serves it, or none is
    found within `work`.

    MACROPs come by their cost; those whose cost only a binding tells come last, and each of them is
    asked. `in_vain` hears of each MACROP that was tried and did not serve.
    """
    work = work if work is not None else MatchingBudget()
    best: LookupHit | None = None
    for entry in index.candidates(asked):
        if best is not None and entry.cost is not None and entry.cost >= best.plan.cost:
            continue
        try:
            hit = _cheapest_hit(entry, asked, work)
        except OutOfWork:
            if best is None:
                in_vain(entry)
            return best
        if hit is None:
            in_vain(entry)
        elif best is None or hit.plan.cost < best.plan.cost:
            best = hit
    return best


def _cheapest_hit(entry: IndexEntry, asked: MacroQuery, work: MatchingBudget) -> LookupHit | None:
    """The cheapest instance of a MACROP; the first, if all cost the same."""
    hits = _checked_instances(entry, asked, work)
    if entry.cost is not None:
        return next(hits, None)
    return min(hits, key=lambda hit: hit.plan.cost, default=None)


def _checked_instances(
    entry: IndexEntry, asked: MacroQuery, work: MatchingBudget
) -> Iterator[LookupHit]:
    program = entry.program
    if program is None:
        return
    for bindings in itertools.islice(match_macro(program, asked, work), MAX_CHECKED_INSTANCES):
        if gives_up(program.macrop, bindings, asked):
            return
        try:
            plan = instantiate_macro(program.macrop, bindings, asked.world.amounts)
        except NotGeneral:
            return
        after = check_instance(plan, asked)
        if isinstance(after, Situation):
            yield LookupHit(entry.key, program.macrop, *shortened(plan, after, asked))
        elif after.lost:
            return


def gives_up(macrop: Macrop, bindings: Mapping[Variable, Term], asked: MacroQuery) -> bool:
    """Whether an instance ends a goal that held and does not achieve it again.

    Only its last steps are examined.

    False if the steps alone do not decide it.
    """
    open_ = {goal.atom for goal in asked.kept if goal.positive and is_ground(goal.atom)}
    statics = asked.world.statics
    for step in reversed(macrop.steps) if open_ else ():
        operator = substitute_atom(step.operator, bindings)
        prepared = asked.world.ground_step(operator) if is_ground(operator) else None
        if prepared is None or prepared.refusal:
            return False
        open_ -= set(prepared.adds)
        if not open_:
            return False
        if prepared.ended(FactSet(open_), statics):
            return True
    return False
