"""Review of the rest of a plan: a better order, or equal objects that exchange their roles.

A plan names them all, because a plan has to be checked. When nothing can begin, and the run waits
for something that needs no hand, what is busy and what is free exchange their roles in the steps
that have not begun, if the run ends sooner then (after Fox and Kempf 1985). Nobody has to declare
what is equal: terms are exchanged if their facts and goals correspond, and the exchanged plan
passes the gate like every plan.
"""

from collections import defaultdict
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction

from cellwright.engine.model.outcome import Found
from cellwright.engine.model.plan_times import earliest_starts
from cellwright.engine.model.troubleshooting import Revision
from cellwright.engine.pipelines.execution.compiled_program import hands_of, unit_ms
from cellwright.engine.pipelines.execution.executable_plan import (
    MAX_RESCHEDULED_STEPS,
    ReadyPlan,
    compile_ready_plan,
    in_windows,
    schedule_again,
)
from cellwright.engine.pipelines.execution.plan_switching import (
    JoinedProgram,
    join_plan,
    left_behind,
    switch_tasks,
    world_ahead,
)
from cellwright.engine.pipelines.execution.run_goals import RunScope, is_wish
from cellwright.engine.pipelines.execution.run_progress import RunProgress
from cellwright.engine.pipelines.planning import checked_plan
from cellwright.engine.pipelines.planning.checked_plan import task_for
from cellwright.engine.pipelines.planning.plan_gate import PlanGate
from cellwright.engine.pipelines.planning.timetable import keep_plan_order, operators_of
from cellwright.engine.pipelines.recovery import Dynamics, WorldState
from cellwright.engine.pipelines.recovery.replanning import recover_goals
from cellwright.engine.stages.execution import ActivityProgram, ExecutiveState
from cellwright.engine.stages.execution.start_forecast import forecast_order
from cellwright.engine.stages.planning import SearchLimits
from cellwright.engine.stages.planning.improvement.plan_reordering import deorder_steps
from cellwright.engine.stages.scheduling.plan_blocks import Unstructured
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.model.conditions import And, Literal, goal_parts
from cellwright.kb.model.domain_model import Kind
from cellwright.kb.model.plan_model import Plan, Step, StepId, full_order
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Atom, Function, Term, natural_key

Exchange = Mapping[Term, Term]  # each term and the one in its place; it is its own reverse


@dataclass(frozen=True, slots=True)
class ExchangeChoice:
    """A program in which equal things have exchanged their roles, and which ones these are."""

    joined: JoinedProgram
    what: str


def exchange_choices(course: RunProgress, scope: RunScope) -> Iterator[ExchangeChoice]:
    """The plan with equal things in place of those that steps under way are busy with."""
    rest_plan = left_behind(course)
    if not rest_plan.steps or len(rest_plan.steps) > MAX_RESCHEDULED_STEPS:
        return
    state, now = world_ahead(course), course.driver.now_ms()
    rest, tasks = scope.rest(state), switch_tasks(course, scope)
    for exchange, plan in exchanged_plans(
        rest, state.facts, busy_terms(course, rest), rest_plan, course.gate
    ):
        if _as_urgent(rest, exchange):
            ready_plan = in_windows(rest, plan, now, course.since) or compile_ready_plan(
                rest, plan, earliest_starts(plan), now, since=course.since
            )
            yield ExchangeChoice(
                join_plan(course, tasks, ready_plan), _exchange_text(exchange, rest_plan.steps)
            )


def exchanged_plans(
    rest: Problem, facts: Iterable[Atom], taken: Collection[Term], rest_plan: Plan, gate: PlanGate
) -> Iterator[tuple[Exchange, Plan]]:
    """What is left of a plan with equal things in place of some, each way once, if the checker
    accepts it.
    """
    tried = set[frozenset[tuple[Term, Term]]]()
    for exchange in possible_exchanges(rest, facts, taken, rest_plan.steps, gate):
        if (pairs := frozenset(exchange.items())) in tried:
            continue
        tried.add(pairs)
        plan = Plan(tuple(_exchange_in_step(step, exchange) for step in rest_plan.steps))
        if not gate.findings(rest, full_order(plan)):
            yield exchange, plan


def possible_exchanges(
    rest: Problem,
    facts: Iterable[Atom],
    taken: Collection[Term],
    steps: Sequence[Step],
    gate: PlanGate,
) -> Iterator[Exchange]:
    """What could be exchanged for what is busy: with each equal thing, all that goes with the
    two of them.
    """
    facts_by_term = _Facts(rest, facts, gate)
    named = {term for step in steps for term in (*step.operator.arguments, *step.resources)}
    for busy_term in sorted(taken, key=natural_key):
        for free_term in sorted(named - {busy_term}, key=natural_key):
            if facts_by_term.kindred(busy_term, free_term):
                yield facts_by_term.exchange(busy_term, free_term)


def busy_terms(course: RunProgress, rest: Problem) -> Mapping[Term, int]:
    """What steps under way are about, but hands, and for how many units of time it will be."""
    steps = {int(step.id): step for step in course.compiled.plan.steps}
    hands, unit = hands_of(rest, course.compiled.plan.steps), unit_ms(rest.domain)
    busy_units: dict[Term, int] = {}
    for running_step in course.standing.running.values():
        lasts = (
            running_step.since_ms
            + course.compiled.program.activities[running_step.activity].lasts_ms
        )
        rest_units = max(0, -((course.driver.now_ms() - lasts) // unit))
        step = steps[running_step.activity]
        for term in (*step.operator.arguments, *step.resources):
            if isinstance(term, Function) and str(term) not in hands:
                busy_units[term] = max(rest_units, busy_units.get(term, 0))
    return busy_units


class _Facts:
    """What is true and what is wanted, by the terms that it is about."""

    def __init__(self, rest: Problem, facts: Iterable[Atom], gate: PlanGate) -> None:
        self.types = {**rest.domain.objects, **rest.objects}
        goals = [part.atom for part in goal_parts(rest.goal) if isinstance(part, Literal)]
        wanted_atoms = [Function(f"goal {atom.name}", atom.arguments) for atom in goals]
        wanted_atoms += [
            Function(f"stage {number} {stage.name}", stage.arguments)
            for chain in rest.chains
            for number, stage in enumerate(chain.stages)
        ]
        self.all = {*facts, *_static_facts(rest, gate), *wanted_atoms}
        self.about: dict[Term, list[Atom]] = defaultdict(list)
        for atom in sorted(self.all, key=natural_key):
            for term in dict.fromkeys(atom.arguments):
                self.about[term].append(atom)

    def kindred(self, one: Term, other: Term) -> bool:
        """Whether two terms could be equal: objects of one type, or compound terms of one
        function.
        """
        if not isinstance(one, Function) or not isinstance(other, Function):
            return False
        if one.arguments or other.arguments:
            return one.name == other.name and one.arguments[:-1] == other.arguments[:-1]
        return one.name in self.types and self.types[one.name] == self.types.get(other.name)

    def exchange(self, one: Term, other: Term) -> Exchange:
        """The two exchanged, and with them what differs in facts about them that correspond:
        the depots of two probes, say.
        """
        exchanged: dict[Term, Term] = {one: other, other: one}
        open_ = [(one, other)]
        while open_:
            term, counterpart = open_.pop()
            for atom in self.about[term]:
                image = _image_of(atom, exchanged)
                if image in self.all:
                    continue
                pair = next(
                    filter(
                        None,
                        (
                            self._differ(image, candidate, exchanged)
                            for candidate in self.about[counterpart]
                        ),
                    ),
                    None,
                )
                if pair is not None:
                    exchanged |= {pair[0]: pair[1], pair[1]: pair[0]}
                    open_.append(pair)
        return exchanged

    def _differ(self, image: Atom, other: Atom, exchange: Exchange) -> tuple[Term, Term] | None:
        """The only terms in which two atoms differ, if these can be exchanged as well."""
        if image.name != other.name or len(image.arguments) != len(other.arguments):
            return None
        pairs = [(a, b) for a, b in zip(image.arguments, other.arguments, strict=True) if a != b]
        if (
            len(pairs) != 1
            or any(term in exchange for term in pairs[0])
            or not self.kindred(*pairs[0])
        ):
            return None
        return pairs[0]


def _static_facts(rest: Problem, gate: PlanGate) -> Iterator[Atom]:
    """The static facts that are about several things."""
    static_facts = gate.semantics(rest).statics
    for name, predicate in rest.domain.predicates.items():
        if predicate.kind is Kind.STATIC and len(predicate.arguments) > 1:
            yield from static_facts.named(name)


def _image_of(term: Term, exchange: Exchange) -> Function:
    """A term in which terms are exchanged."""
    image = exchange.get(term, term)
    assert isinstance(image, Function)
    if image is not term or not image.arguments:
        return image
    arguments = tuple(
        _image_of(argument, exchange) if isinstance(argument, Function) else argument
        for argument in image.arguments
    )
    return Function(image.name, arguments)


def _as_urgent(rest: Problem, exchange: Exchange) -> bool:
    """Whether what is exchanged is due at the same times."""
    times = [atom for atom in rest.statics if is_wish(rest, atom)]
    return all(_image_of(atom, exchange) in times for atom in times)


def _exchange_in_step(step: Step, exchange: Exchange) -> Step:
    resources = tuple(
        _image_of(resource, exchange) if isinstance(resource, Function) else resource
        for resource in step.resources
    )
    return replace(step, operator=_image_of(step.operator, exchange), resources=resources)


def _exchange_text(exchange: Exchange, steps: Sequence[Step]) -> str:
    """What is exchanged, as far as the steps name it."""
    named = {term for step in steps for term in (*step.operator.arguments, *step.resources)}
    pairs = {tuple(sorted(map(str, pair))) for pair in exchange.items() if named & set(pair)}
    return ", ".join(" and ".join(pair) for pair in sorted(pairs))


PAYS_MS = 10_000  # by which another plan has to be done sooner
MIN_GAIN_SHARE = 50  # or this part of what is left, if that is more


@dataclass(frozen=True, slots=True)
class Prospect:
    """What will come of a program as things stand: by how much things stay too long in all, when
    all is done, and when its steps will have ended on the average.
    """

    late_ms: int
    end_ms: int
    mean_ms: int


@dataclass(frozen=True, slots=True)
class BetterPlan:
    """A better way to go on, and what is better about it."""

    joined: JoinedProgram
    why: str


def review_plan(course: RunProgress, scope: RunScope, limits: SearchLimits) -> BetterPlan | None:
    """A better plan for what is left, with what is under way as it is; None if there is none.

    After a review that came to nothing, the next one waits until something has begun or ended, and
    needs twice as much reason.
    """
    stands = course.standing.done, frozenset(course.standing.running)
    if stands == course.looked:
        return None
    better = _best_other_plan(course, scope, limits)
    course.looked = None if better is not None else stands
    course.calm = 1 if better is not None else 2 * course.calm
    return better


def _best_other_plan(
    course: RunProgress, scope: RunScope, limits: SearchLimits
) -> BetterPlan | None:
    now = course.driver.now_ms()
    present = forecast_prospect(course.compiled.program, course.standing, now)
    best: tuple[Prospect, JoinedProgram] | None = None
    tasks = switch_tasks(course, scope)
    for ready_plan in _other_plans(course, scope, limits, present.late_ms > 0):
        new = join_plan(course, tasks, ready_plan)
        new_prospect = forecast_prospect(new.ready.compiled.program, new.standing, now)
        if best is None or _prospect_value(new_prospect) < _prospect_value(best[0]):
            best = new_prospect, new
    if best is None or not _pays_off(present, best[0], now):
        return None
    return BetterPlan(best[1], _gain_text(present, best[0]))


def choose_exchange(course: RunProgress, scope: RunScope) -> ExchangeChoice | None:
    """The choice among equal things with which all is done soonest; None if that of the plan
    loses nothing.
    """
    now = course.driver.now_ms()
    best, choice_found = (
        _prospect_value(forecast_prospect(course.compiled.program, course.standing, now)),
        None,
    )
    for choice in exchange_choices(course, scope):
        value = _prospect_value(
            forecast_prospect(choice.joined.ready.compiled.program, choice.joined.standing, now)
        )
        if value < best:
            best, choice_found = value, choice
    return choice_found


def _prospect_value(future: Prospect) -> tuple[int, int, int]:
    return future.late_ms, future.end_ms, future.mean_ms


def _pays_off(present: Prospect, other: Prospect, now_ms: int) -> bool:
    """Whether it is worth it to follow another plan: one that is done sooner, or no later and with
    its steps sooner.

    What is done early cannot be late any more, so steps that need not wait do not wait.
    """
    if other.late_ms != present.late_ms:
        return other.late_ms < present.late_ms
    least = max(PAYS_MS, (present.end_ms - now_ms) // MIN_GAIN_SHARE)
    sooner = present.end_ms - other.end_ms
    return sooner > least or (sooner >= 0 and present.mean_ms - other.mean_ms > least)


def _gain_text(present: Prospect, other: Prospect) -> str:
    if other.late_ms < present.late_ms:
        saved = (present.late_ms - other.late_ms) / 1000
        return f"things stay {saved:g} s less than before beyond what they may"
    if other.end_ms < present.end_ms:
        return f"all is done {(present.end_ms - other.end_ms) / 1000:g} s sooner"
    return f"steps end {(present.mean_ms - other.mean_ms) / 1000:g} s sooner on the average"


def forecast_prospect(program: ActivityProgram, standing: ExecutiveState, now_ms: int) -> Prospect:
    """What will come of a program if all goes as forecast from now on, in the order of the
    forecast.
    """
    begins, ends = _begins_and_ends(program, standing, now_ms)
    late = 0
    for dwell in program.dwells:
        until = standing.dwelling.get(dwell)
        if until is None and dwell.source in ends:
            until = ends[dwell.source] + dwell.most_ms
        if until is not None and dwell.target in begins:
            late += max(0, begins[dwell.target] - until)
    return Prospect(
        late, max(ends.values(), default=now_ms), sum(ends.values()) // max(1, len(ends))
    )


def _begins_and_ends(
    program: ActivityProgram, standing: ExecutiveState, now_ms: int
) -> tuple[Mapping[int, int], Mapping[int, int]]:
    """When each activity that has not begun will begin, and when each that has not ended will
    end.
    """
    under_way = {running.activity: running.since_ms for running in standing.running.values()}
    lasts = {number: program.activities[number].lasts_ms for number in program.activities}
    ends = {number: max(now_ms, since + lasts[number]) for number, since in under_way.items()}
    free = {r: ends[number] for number in under_way for r in program.activities[number].resources}
    begins: dict[int, int] = {}
    for number in forecast_order(program, standing):
        activity = program.activities[number]
        times = [now_ms, *(ends[b] for b in activity.after if b in ends)]
        times += [free[r] for r in activity.resources if r in free]
        begins[number] = max([*times, activity.start_ms] if program.timed else times)
        ends[number] = begins[number] + lasts[number]
        free |= dict.fromkeys(activity.resources, ends[number])
    return begins, ends


def _other_plans(
    course: RunProgress, scope: RunScope, limits: SearchLimits, late: bool
) -> Iterator[ReadyPlan]:
    """Other plans for what is left, from the world on that will be when what is under way has
    ended.
    """
    state, rest_plan, now = world_ahead(course), left_behind(course), course.driver.now_ms()
    if not rest_plan.steps:
        return
    rest = scope.rest(state)
    try:
        if len(rest_plan.steps) <= MAX_RESCHEDULED_STEPS:
            yield schedule_again(
                rest, rest_plan, now, limits, course.since, busy_terms(course, rest)
            )
        if late and (plan := _taken_away(course, scope, state, limits)) is not None:
            yield in_windows(rest, plan, now, course.since) or compile_ready_plan(
                rest, plan, keep_plan_order(rest, plan).starts, now, since=course.since
            )
    except InvalidInput:
        return  # what is left has no schedule: the plan stays as it is


def _taken_away(
    course: RunProgress, scope: RunScope, state: WorldState, limits: SearchLimits
) -> Plan | None:
    """A plan that first takes away what would stay too long; None if there is none, or if
    nothing is taken away sooner by it.
    """
    waiting = sorted(
        course.standing.dwelling.items(),
        key=lambda waiting_dwell: (waiting_dwell[1], waiting_dwell[0].target),
    )
    if not waiting:
        return None
    rest, target = scope.rest(state), waiting[0][0].target
    first = _way_to(course, rest, target, state, limits)
    if first is None or not _is_sooner(course, first, target, unit_ms(rest.domain)):
        return None
    dynamics, after = (
        Dynamics(rest),
        WorldState(state.facts, {chain.name: 0 for chain in rest.chains}),
    )
    for step in first.steps:
        after = dynamics.after(step.operator, after)
    reached = {name: state.reached[name] + more for name, more in after.reached.items()}
    then = scope.rest(WorldState(after.facts, {**state.reached, **reached}))
    second = recover_goals(then, Revision(), limits, None, after.facts)
    if not isinstance(second.outcome, Found) or second.given_up:
        return None
    return _single_plan(rest, (*first.steps, *second.outcome.plan.steps))


def _way_to(
    course: RunProgress, rest: Problem, target: int, state: WorldState, limits: SearchLimits
) -> Plan | None:
    """The steps that take something away, and what has to be done before; None if there are
    none.
    """
    adds = course.compiled.changes[target].adds
    if course.way is None or course.way[:2] != (adds, state.facts):
        goal = And(tuple(map(Literal, adds)))
        outcome = checked_plan.plan_problem(replace(rest, goal=goal, chains=()), limits)
        course.way = adds, state.facts, outcome.plan if isinstance(outcome, Found) else None
    return course.way[2]


def _is_sooner(course: RunProgress, first: Plan, target: int, unit: Fraction) -> bool:
    """Whether something can be taken away sooner than it will be, if nothing else is done before.

    A step waits for what is under way as the same step of the plan does.
    """
    program, now = course.compiled.program, course.driver.now_ms()
    begins, ends = _begins_and_ends(program, course.standing, now)
    under_way = {running.activity for running in course.standing.running.values()}
    waits = {
        program.activities[number].action: program.activities[number].after
        for number in reversed(begins)
    }
    free = {r: ends[number] for number in under_way for r in program.activities[number].resources}
    start, done = now, dict[StepId, int]()
    for step in first.steps:
        times = [
            now,
            *(done[number] for number in step.after),
            *(free.get(str(r), now) for r in step.resources),
        ]
        behind = [
            ends[number] for number in waits.get(str(step.operator), ()) if number in under_way
        ]
        start = max(times + behind)
        done[step.id] = start + int(step.duration * unit)
        free |= dict.fromkeys(map(str, step.resources), done[step.id])
    return start < begins.get(target, start)


def _single_plan(rest: Problem, steps: tuple[Step, ...]) -> Plan:
    """One plan of steps in a sequence, with the orders that it needs."""
    plan = full_order(
        Plan(tuple(replace(s, id=StepId(n + 1), after=()) for n, s in enumerate(steps)))
    )
    task = task_for(rest, plan)
    try:
        return deorder_steps(task, *operators_of(task, plan))
    except Unstructured:
        return plan
