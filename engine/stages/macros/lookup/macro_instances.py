"""Instances of MACROPs: made of their variables, and checked against the query they shall serve."""

import itertools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from cellwright.engine.stages.lifted.cell_domain import CellDomain, Situation
from cellwright.engine.stages.lifted.fact_queries import Bindings, is_satisfiable
from cellwright.engine.stages.lifted.lifted_execution import LiftedExecution
from cellwright.engine.stages.lifted.operator_schemas import GuardedAtom, NotGeneral
from cellwright.engine.stages.macros.lookup.macro_query import MacroQuery, is_met
from cellwright.kb.model.conditions import Literal
from cellwright.kb.model.operator_amounts import Amounts, NoAmount
from cellwright.kb.model.plan_model import CausalLink, Macrop, MacroStep, Plan, Step
from cellwright.kb.model.planning_problem import (
    advance_chains,
    final_stages,
    initial_progress,
    late_stages,
    stage_holds,
    stages_in_turn,
    too_early,
)
from cellwright.kb.terms import (
    Atom,
    Term,
    Variable,
    is_ground,
    match_term,
    substitute_atom,
    substitute_term,
)


def instantiate_macro(macrop: Macrop, bindings: Mapping[Variable, Term], amounts: Amounts) -> Plan:
    """The plan of a MACROP under `bindings`.

    Raises `NotGeneral` if a variable of a step, its duration or its cost has no value.
    """
    steps = tuple(_instantiate_step(step, bindings, amounts) for step in macrop.steps)
    conditions = {
        condition: substitute_atom(condition, bindings)
        for condition in {link.condition for link in macrop.links}
    }
    links = tuple(
        CausalLink(link.producer, conditions[link.condition], link.consumer)
        for link in macrop.links
    )
    return Plan(steps, links)


def _instantiate_step(step: MacroStep, bindings: Mapping[Variable, Term], amounts: Amounts) -> Step:
    operator = substitute_atom(step.operator, bindings)
    if not is_ground(operator):
        raise NotGeneral(f"{operator} has a variable without a value")
    resources = tuple([substitute_term(resource, bindings) for resource in step.resources])
    try:
        duration, cost = amounts.of(step.duration, bindings, 0), amounts.of(step.cost, bindings, 1)
    except NoAmount as error:
        raise NotGeneral(str(error)) from None
    return Step(step.id, operator, step.after, resources, duration, cost)


@dataclass(frozen=True, slots=True)
class MacroRefusal:
    """The reason why a plan does not serve a query.

    `lost` says that the plan ends a goal that held before. Other instances of the MACROP would end
    it, too.
    """

    reason: str
    lost: bool = False


def check_instance(plan: Plan, asked: MacroQuery) -> Situation | MacroRefusal:
    """The situation after a plan, if it serves the query in every order that it allows; else
    why not.
    """
    run = LiftedExecution(asked.world, asked.facts)
    try:
        refusal = run.run(plan)
    except NotGeneral as error:
        refusal = str(error)
    if refusal:
        return MacroRefusal(refusal)
    end = Situation(asked.world, run.facts)
    missed = next((goal for goal in (*asked.goals, *asked.kept) if not is_met(goal, end)), None)
    if missed is not None:
        return MacroRefusal(f"{missed} does not hold at the end", missed in asked.kept)
    refusal = _unfinished_chain(plan, asked, run, end) or _disturbing_steps(plan, run)
    return MacroRefusal(refusal) if refusal else end


def _unfinished_chain(plan: Plan, asked: MacroQuery, run: LiftedExecution, end: Situation) -> str:
    """Which chain of the workflow is not worked through, as soon as possible and in order; or
    nothing.
    """
    if not asked.chains:
        event = next((event for change in run.changes.values() for event in change.events), None)
        return f"{event} is not the next stage of any chain" if event is not None else ""
    facts = asked.facts
    late, reached = (
        late_stages(asked.chains, asked.world.domain),
        initial_progress(asked.chains, stage_holds(facts)),
    )
    for step in plan.steps:
        change = run.changes[step.id]
        after = change.applied(facts)
        counts, unexpected = advance_chains(
            asked.chains, reached, change.events, stage_holds(after)
        )
        now = stages_in_turn(asked.chains, reached, counts) if late else []
        early = too_early(late, change.adds, stage_holds(facts), now) if late else None
        if wrong := next((fault for fault in (*unexpected, early) if fault is not None), None):
            return f"{wrong} is not the next stage of any chain"
        facts, reached = after, counts
    open_ = next(
        (chain.name for chain in asked.chains if reached[chain.name] < len(chain.stages)), None
    )
    if open_ is not None:
        return f"the workflow of {open_} is not finished"
    lasting_stages = (
        last for own in final_stages(asked.chains, asked.world.domain).values() for last in own
    )
    return next((f"{last} does not last" for last in lasting_stages if last not in end.facts), "")


def _disturbing_steps(plan: Plan, run: LiftedExecution) -> str:
    """Names two unordered steps that share a resource or disturb each other's effects; or an
    empty text.
    """
    if all(step.id in next_step.after for step, next_step in itertools.pairwise(plan.steps)):
        return ""
    before = plan.predecessors()
    for step, rival in itertools.combinations(plan.steps, 2):
        if step.id in before[rival.id] or rival.id in before[step.id]:
            continue
        shared = set(step.resources) & set(rival.resources)
        if (
            shared
            or _harms_rival(step, rival, plan, run)
            or _harms_rival(rival, step, plan, run)
            or _serves_later(step, rival, run)
        ):
            return f"steps {step.id} and {rival.id} disturb each other"
    return ""


def _serves_later(step: Step, later: Step, run: LiftedExecution) -> bool:
    """Whether a step makes something true that a later one in the list needs, and that was not
    true before.
    """
    adds, before = run.changes[step.id].adds, run.before[step.id]
    return any(atom in adds and atom not in before for atom in _precondition_atoms(later, run))


def _harms_rival(step: Step, rival: Step, plan: Plan, run: LiftedExecution) -> bool:
    """Whether `step` denies an atom that `rival` adds or needs, or adds one that must be absent
    for it.
    """
    link_conditions = [link.condition for link in plan.links if link.consumer == rival.id]
    absent = [c.arguments[0] for c in link_conditions if c.name == "not" and len(c.arguments) == 1]
    if any(atom in run.changes[step.id].adds for atom in absent):
        return True
    protected = {
        *run.changes[rival.id].adds,
        *(c for c in link_conditions if c.name != "not"),
        *_precondition_atoms(rival, run),
    }
    schema, bindings = run.world.binding(step.operator)
    return any(
        _may_deny(denial, atom, bindings, run.world)
        for denial in schema.denies
        for atom in protected
    )


def _precondition_atoms(step: Step, run: LiftedExecution) -> Iterator[Atom]:
    """The atoms that a step's precondition names."""
    schema, bindings = run.world.binding(step.operator)
    for part in (part for body in schema.alternatives for part in body):
        if isinstance(part, Literal) and part.positive and run.world.schemas.is_dynamic(part):
            atom = substitute_atom(part.atom, bindings)
            if is_ground(atom):
                yield atom


def _may_deny(denial: GuardedAtom, atom: Atom, bindings: Bindings, world: CellDomain) -> bool:
    """Whether a consequence denies an atom in some state."""
    if denial.atom.name != atom.name:
        return False
    match_bindings = match_term(denial.atom, atom, bindings)
    return match_bindings is not None and is_satisfiable(
        denial.guard, world.statics, match_bindings
    )
