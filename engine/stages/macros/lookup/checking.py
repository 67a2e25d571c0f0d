"""A fast check of an instance of a MACROP.

The plan is executed in the situation, step by step, with the domain's own operators. The check does not
depend on matching: it sees only the finished plan and the problem's goals, never a MACROP. It shares the
operator schemas with generalisation, so the gate (`cellwright.engine.pipelines.gate`) checks the plan again.
"""

import itertools
from collections.abc import Iterator
from dataclasses import dataclass

from cellwright.engine.stages.macros.lifted.bodies import Bindings, satisfiable
from cellwright.engine.stages.macros.lifted.deduction import Following
from cellwright.engine.stages.macros.lifted.execution import Execution
from cellwright.engine.stages.macros.lifted.schema import NotGeneral
from cellwright.engine.stages.macros.lifted.situation import Situation
from cellwright.engine.stages.macros.lifted.world import CellDomain
from cellwright.engine.stages.macros.lookup.query import Query, is_met
from cellwright.kb.model.conditions import Literal
from cellwright.kb.model.plan import Plan, Step
from cellwright.kb.model.workflow import advanced, begun, holding, in_turn, lasting, late_stages, too_early
from cellwright.kb.terms import Atom, is_ground, match, substitute_atom


@dataclass(frozen=True, slots=True)
class Refusal:
    """The reason why a plan does not serve a query.

    `lost` says that the plan ends a goal that held before. Other instances of the MACROP would end it, too.
    """

    reason: str
    lost: bool = False


def check(plan: Plan, asked: Query) -> Situation | Refusal:
    """The situation after a plan, if it serves the query in every order that it allows; else why not."""
    run = Execution(asked.world, asked.facts)
    try:
        refusal = run.run(plan)
    except NotGeneral as error:
        refusal = str(error)
    if refusal:
        return Refusal(refusal)
    end = Situation(asked.world, run.facts)
    missed = next((goal for goal in (*asked.goals, *asked.kept) if not is_met(goal, end)), None)
    if missed is not None:
        return Refusal(f"{missed} does not hold at the end", missed in asked.kept)
    refusal = _unfinished(plan, asked, run, end) or _disturbed(plan, run)
    return Refusal(refusal) if refusal else end


def _unfinished(plan: Plan, asked: Query, run: Execution, end: Situation) -> str:
    """Which chain of the workflow is not worked through, as soon as possible and in order; or nothing."""
    if not asked.chains:
        event = next((event for change in run.changes.values() for event in change.events), None)
        return f"{event} is not the next stage of any chain" if event is not None else ""
    facts = asked.facts
    late, reached = late_stages(asked.chains, asked.world.domain), begun(asked.chains, holding(facts))
    for step in plan.steps:
        change = run.changes[step.id]
        after = change.applied(facts)
        counts, unexpected = advanced(asked.chains, reached, change.events, holding(after))
        now = in_turn(asked.chains, reached, counts) if late else []
        early = too_early(late, change.adds, holding(facts), now) if late else None
        if wrong := next((each for each in (*unexpected, early) if each is not None), None):
            return f"{wrong} is not the next stage of any chain"
        facts, reached = after, counts
    open_ = next((each.name for each in asked.chains if reached[each.name] < len(each.stages)), None)
    if open_ is not None:
        return f"the workflow of {open_} is not finished"
    wanted = (last for own in lasting(asked.chains, asked.world.domain).values() for last in own)
    return next((f"{last} does not last" for last in wanted if last not in end.facts), "")


def _disturbed(plan: Plan, run: Execution) -> str:
    """Names two unordered steps that share a resource or disturb each other's effects; or an empty text."""
    if all(one.id in other.after for one, other in itertools.pairwise(plan.steps)):
        return ""
    before = plan.predecessors()
    for one, other in itertools.combinations(plan.steps, 2):
        if one.id in before[other.id] or other.id in before[one.id]:
            continue
        shared = set(one.resources) & set(other.resources)
        if (
            shared
            or _harms(one, other, plan, run)
            or _harms(other, one, plan, run)
            or _serves(one, other, run)
        ):
            return f"steps {one.id} and {other.id} disturb each other"
    return ""


def _serves(step: Step, later: Step, run: Execution) -> bool:
    """Whether a step makes something true that a later one in the list needs, and that was not true before."""
    adds, before = run.changes[step.id].adds, run.before[step.id]
    return any(atom in adds and atom not in before for atom in _preconditions(later, run))


def _harms(step: Step, rival: Step, plan: Plan, run: Execution) -> bool:
    """Whether `step` denies an atom that `rival` adds or needs, or adds one that must be absent for it."""
    wanted = [link.condition for link in plan.links if link.consumer == rival.id]
    absent = [c.arguments[0] for c in wanted if c.name == "not" and len(c.arguments) == 1]
    if any(atom in run.changes[step.id].adds for atom in absent):
        return True
    kept = {*run.changes[rival.id].adds, *(c for c in wanted if c.name != "not"), *_preconditions(rival, run)}
    schema, bindings = run.world.binding(step.operator)
    return any(_may_deny(each, atom, bindings, run.world) for each in schema.denies for atom in kept)


def _preconditions(step: Step, run: Execution) -> Iterator[Atom]:
    """The atoms that a step's precondition names."""
    schema, bindings = run.world.binding(step.operator)
    for part in (part for body in schema.alternatives for part in body):
        if isinstance(part, Literal) and part.positive and run.world.schemas.is_dynamic(part):
            atom = substitute_atom(part.atom, bindings)
            if is_ground(atom):
                yield atom


def _may_deny(each: Following, atom: Atom, bindings: Bindings, world: CellDomain) -> bool:
    """Whether a consequence denies an atom in some state."""
    if each.atom.name != atom.name:
        return False
    found = match(each.atom, atom, bindings)
    return found is not None and satisfiable(each.guard, world.statics, found)
