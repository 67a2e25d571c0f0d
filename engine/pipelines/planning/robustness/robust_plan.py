"""Is every window of a plan kept whatever happens in the ranges of its steps, and by which policy?

The plan keeps its steps, and the order in which they hold resources. If it has no policy, the same
steps are scheduled once more with their longest durations: that order may have one.
"""

from collections.abc import Mapping
from dataclasses import replace
from math import log

from cellwright.engine.model.robustness import (
    NarrowedRange,
    RobustPlan,
    WidenedWindow,
    WindowChance,
)
from cellwright.engine.model.start_rules import StartRule, StartRules
from cellwright.engine.model.uncertain_times import (
    ORIGIN,
    DispatchableNetwork,
    Relaxation,
    UncertainNetwork,
)
from cellwright.engine.pipelines.planning.robustness.cycle_wording import cycle_lines
from cellwright.engine.pipelines.planning.robustness.plan_network import (
    PlanNetwork,
    network_of_plan,
)
from cellwright.engine.stages.uncertainty.controllability import find_policy
from cellwright.engine.stages.uncertainty.least_relaxation import (
    NarrowingCost,
    narrow_links,
    relax_bounds,
    relaxed_network,
)
from cellwright.engine.stages.uncertainty.window_chances import (
    DrawnDuration,
    TimedRuns,
    Times,
    draw_runs,
)
from cellwright.kb.diagnostics import Diagnostic, InvalidInput
from cellwright.kb.model.operator_amounts import NoAmount
from cellwright.kb.model.plan_model import Plan, StepId
from cellwright.kb.model.planning_problem import Problem

MAX_PRICED_UNITS = 2_000  # units by which a range may be narrowed, at prices of their own
PRICE_OF_CERTAINTY = 100_000  # the price of a chance of 1/e, in the numbers of the solver
NO_CHANCE = 1e-9


def judge_robustness(
    problem: Problem, plan: Plan, starts: Mapping[StepId, int], timed: bool
) -> RobustPlan:
    """What is known of a plan whose steps hold resources in the order of these starts.

    Where it is `timed`, steps that are executed without a policy do not begin before their starts.
    Raises `InvalidInput` for a range that cannot be told.
    """
    try:
        made = network_of_plan(problem, plan, starts)
    except NoAmount as error:
        raise InvalidInput([Diagnostic(problem.where, "K115", str(error), error.hint)]) from None
    chances, kept = _window_chances(made, plain_rules(made, starts, timed))
    policy = find_policy(made.network)
    if isinstance(policy, DispatchableNetwork):
        rules = rules_of(made, made.network, policy)
        return RobustPlan(
            len(made.varying),
            rules,
            chances=chances,
            kept=kept,
            worst_end=_latest_end(made, rules),
        )
    lines, lacks = cycle_lines(made, policy)
    return _with_relaxations(
        made,
        RobustPlan(len(made.varying), cycle=lines, lacks=lacks, chances=chances, kept=kept),
    )


def _with_relaxations(made: PlanNetwork, answer: RobustPlan) -> RobustPlan:
    """The answer for a plan without a policy, with what would have to change."""
    network = made.network
    widening = relax_bounds(network)
    if widening is not None:
        by_window: dict[str, int] = {}
        for number, by in widening.bounds.items():
            says = network.bounds[number].says
            by_window[says] = max(by_window.get(says, 0), by)
        widened = tuple(WidenedWindow(says, by) for says, by in by_window.items())
        answer = replace(answer, widened=widened)
    narrowing = narrow_links(network, [_narrowing_cost(duration) for duration in _drawn(made)])
    if narrowing is None:
        return answer
    narrower = relaxed_network(network, narrowing)
    policy = find_policy(narrower)
    assert isinstance(policy, DispatchableNetwork)
    return replace(
        answer,
        narrowed=tuple(_narrowed_ranges(made, narrowing)),
        narrowed_rules=rules_of(made, narrower, policy),
        within=_chance_within(made, narrower),
    )


def _narrowed_ranges(made: PlanNetwork, narrowing: Relaxation) -> list[NarrowedRange]:
    return [
        NarrowedRange(
            step.id,
            str(step.operator),
            (link.least, link.most),
            (link.least + narrowing.earliest.get(n, 0), link.most - narrowing.latest.get(n, 0)),
        )
        for n, (step, link) in enumerate(zip(made.varying, made.network.links, strict=True))
        if n in narrowing.earliest or n in narrowing.latest
    ]


def _drawn(made: PlanNetwork) -> list[DrawnDuration]:
    """The durations of the varying steps."""
    ranges = [made.ranges[step.id] for step in made.varying]
    return [DrawnDuration(r.least, r.most, r.usual, r.spread) for r in ranges]


def _narrowing_cost(duration: DrawnDuration) -> NarrowingCost:
    """What chance is lost when a range is cut at its ends, as a price: chances multiply, so their
    logarithms add up.
    """
    width = duration.most - duration.least
    units = range(min(width, MAX_PRICED_UNITS) + 1)
    last = width > MAX_PRICED_UNITS

    def price(kept: float) -> int:
        return round(-PRICE_OF_CERTAINTY * log(max(kept, NO_CHANCE)))

    least = [price(1 - duration.chance_below(duration.least + by)) + by for by in units]
    most = [price(duration.chance_below(duration.most - by)) + by for by in units]
    beyond = [price(0.0) + MAX_PRICED_UNITS] * (width - MAX_PRICED_UNITS if last else 0)
    return NarrowingCost((*least, *beyond), (*most, *beyond))


def _chance_within(made: PlanNetwork, narrower: UncertainNetwork) -> float:
    chance = 1.0
    for duration, link in zip(_drawn(made), narrower.links, strict=True):
        below = duration.chance_below(link.least) if link.least > duration.least else 0.0
        chance *= max(0.0, duration.chance_below(link.most) - below)
    return chance


def rules_of(
    made: PlanNetwork, network: UncertainNetwork, policy: DispatchableNetwork
) -> StartRules:
    """A policy as rules for steps. Ends of steps that do not vary are times after their starts."""
    step_at = {made.start(step.id): step.id for step in made.plan.steps}
    step_at |= {made.end(step.id): step.id for step in made.plan.steps}
    ends = {made.end(step.id) for step in made.plan.steps}
    fixed = {made.end(s.id): made.ranges[s.id] for s in made.plan.steps}
    parts = {int(step.id): StartRule(0, {}, {}, {}) for step in made.plan.steps}
    floors: dict[int, int] = {}
    for bound in policy.bounds:
        if bound.earlier in ends:
            continue
        step, lag = int(step_at[bound.earlier]), -bound.most
        if bound.later == ORIGIN:
            floors[step] = max(floors.get(step, 0), lag)
            continue
        other, rule = int(step_at[bound.later]), parts[step]
        lags: Mapping[int, int] = rule.starts
        if bound.later in ends and fixed[bound.later].varies:
            lags = rule.ends
        elif bound.later in ends:
            lag += fixed[bound.later].usual
        assert isinstance(lags, dict)
        lags[other] = max(lags.get(other, lag), lag)
    for wait in policy.waits:
        link, waits = network.links[wait.link], parts[int(step_at[wait.waiting])].waits
        assert isinstance(waits, dict)
        waits[int(step_at[link.start])] = wait.time
    return {
        number: replace(parts[number], floor=floors.get(number, 0))
        for point in policy.order
        if point in step_at and point not in ends
        for number in [int(step_at[point])]
    }


def plain_rules(made: PlanNetwork, starts: Mapping[StepId, int], timed: bool) -> StartRules:
    """How steps start without a policy: when those before them have ended and their resources are
    free, and where the plan is `timed` not before their forecast.
    """
    ends: dict[StepId, dict[int, int]] = {step.id: {} for step in made.plan.steps}
    for earlier, later, _, _ in made.lags:
        ends[later][int(earlier)] = 0
    places = {step.id: place for place, step in enumerate(made.plan.steps)}
    in_time = sorted(made.plan.steps, key=lambda step: (starts[step.id], places[step.id]))
    return {
        int(step.id): StartRule(starts[step.id] if timed else 0, {}, ends[step.id])
        for step in in_time
    }


def _window_chances(made: PlanNetwork, rules: StartRules) -> tuple[tuple[WindowChance, ...], float]:
    """With which chance each window is kept, and all of them."""
    durations = {
        int(step.id): DrawnDuration(r.least, r.most, r.usual, r.spread)
        for step in made.plan.steps
        for r in [made.ranges[step.id]]
    }
    runs = draw_runs(rules, durations)
    chances, in_all = list[WindowChance](), None
    for window in made.windows:
        kept = runs.kept(
            _time_at(made, runs, window.earlier),
            _time_at(made, runs, window.later),
            window.least,
            window.most,
        )
        chances.append(WindowChance(window.says, float(kept.mean())))
        in_all = kept if in_all is None else in_all * kept
    return tuple(chances), 1.0 if in_all is None else float(in_all.mean())


def _time_at(made: PlanNetwork, runs: TimedRuns, point: int) -> Times:
    """The times of a point in all runs."""
    steps = made.plan.steps
    if point == ORIGIN:
        beginning: Times = next(iter(runs.starts.values())) * 0
        return beginning
    number = int(steps[(point - 1) // 2].id)
    return runs.starts[number] if point % 2 else runs.ends[number]


def _latest_end(made: PlanNetwork, rules: StartRules) -> int:
    """When all has ended if every step takes as long as it can."""
    durations = {
        int(s.id): DrawnDuration(r.most, r.most)
        for s in made.plan.steps
        for r in [made.ranges[s.id]]
    }
    runs = draw_runs(rules, durations, draws=1)
    return round(max((float(end[0]) for end in runs.ends.values()), default=0.0))
