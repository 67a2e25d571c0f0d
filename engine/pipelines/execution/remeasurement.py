"""Measuring again in an inspection: datums that locate the part, doubtful and undecided values.

A run whose problem has an alignment, and whose domain says how uncertain values are, first follows
its plan as far as the last datum. Then it is found out where the part lies, and all that is left is
planned for the part as it lies. At the end of the plan bad values are looked for; they are
repeated. A decision that further values may bring is worth so much time as the domain says: the
planner says how long they take.
"""

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from cellwright.engine.model.outcome import Found
from cellwright.engine.model.part_measurements import chooses_tools, names_in_goal
from cellwright.engine.model.shape_fits import Alignment, Unaligned
from cellwright.engine.model.verdicts import MeasuredFeature, Spoilt
from cellwright.engine.pipelines import inspection
from cellwright.engine.pipelines.execution.executable_plan import ReadyPlan
from cellwright.engine.pipelines.execution.planner_choice import choose_and_plan
from cellwright.engine.pipelines.execution.run_goals import RunScope
from cellwright.engine.pipelines.inspection.nominal_values import MeasurementJudge
from cellwright.engine.pipelines.inspection.part_alignment import PartAlignment
from cellwright.engine.pipelines.inspection.remeasurement_worth import (
    RemeasurementOffer,
    chance_of_decision,
    remeasurement_offers,
)
from cellwright.engine.stages.planning import SearchLimits
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.model.conditions import And, Condition, Exists, Literal, goal_parts
from cellwright.kb.model.measured_results import COVERAGE_FACTOR, Conformity, Measured
from cellwright.kb.model.plan_model import Plan
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Atom, Function

MAX_DATUM_VALUES = 12  # values of one datum
MAX_HINT_POINTS = 3  # points that a hint names


def datums_asked(problem: Problem) -> tuple[str, ...]:
    """The datums that are to be measured before everything else; none if the run does not find
    the part by itself.
    """
    if (
        not chooses_tools(problem.domain)
        or problem.domain.conventions.alignment not in problem.domain.predicates
    ):
        return ()
    # it needs numpy
    return inspection.alignment_asked(problem)


def first_stage(ready: ReadyPlan, scope: RunScope) -> tuple[Plan, RunScope] | None:
    """The steps of a plan up to its last datum, and their goals; None if the part is not to be
    found, or the plan has not all datums.
    """
    asked, measuring = set(datums_asked(scope.problem)), MeasurementJudge(scope.problem)
    if not asked:
        return None
    expected_values = [
        (n, measuring.expected(step.operator)) for n, step in enumerate(ready.plan.steps)
    ]
    mine = {
        expected.of: n
        for n, expected in expected_values
        if expected is not None and expected.of in asked and expected.uncertainty
    }
    if set(mine) != asked:
        return None
    _require_held(scope.problem)
    steps = ready.plan.steps[: max(mine.values()) + 1]
    goals = [str(part) for part in goal_parts(scope.problem.goal) if names_in_goal(part, asked)]
    return Plan(steps), scope.cut({}, goals)


def _require_held(problem: Problem) -> None:
    """Refuse datums that cannot show where the part lies, however well they are measured, and
    name points that would help.
    """
    from cellwright.engine.stages.fitting.datum_alignment import datums_that_hold, lacking_datums

    asked = inspection.datum_points(problem)
    planned = inspection.datums_of_points(
        [(point, 0.0) for point in asked.values()], [1.0] * len(asked)
    )
    reason = lacking_datums(planned)
    if reason is None:
        return
    other_points = [
        (point, 0.0)
        for name, point in inspection.known_profiles(problem).items()
        if name not in asked
    ]
    best = (
        datums_that_hold(
            planned, inspection.datums_of_points(other_points, [1.0] * len(other_points))
        )
        if other_points
        else ()
    )
    word, last = problem.domain.conventions.alignment, max(point.step for point in asked.values())
    facts = ", ".join(f"{word}({name}, {last})" for name in best[:MAX_HINT_POINTS])
    hint = f"add more, such as {facts}" if facts else "add points that hold it"
    raise InvalidInput([Diagnostic(Source(problem.path), "K421", reason, f"{hint}, to `statics`")])


def locate_part(
    problem: Problem, measured: Sequence[Measured]
) -> tuple[tuple[str, ...], Alignment | Unaligned]:
    """The datums, and where the part lies by their last values, or why it fits nowhere."""
    from cellwright.engine.stages.fitting.datum_alignment import align_by_datums

    datums = inspection.measured_datums(problem, measured)
    if datums is None:
        return (), Unaligned("not all datums were measured")
    return datums.names, align_by_datums(datums)


@dataclass(frozen=True, slots=True)
class DatumLooks:
    """Datums that are measured again before the part counts as found, with how often; `refused`
    says why measuring again is not enough.
    """

    names: Mapping[str, int] = field(default_factory=dict)
    told: str = ""
    refused: str = ""


def looks_needed(
    problem: Problem, measured: Sequence[Measured], alignment: Alignment
) -> DatumLooks | None:
    """What a demand on how well the part is known (`aligned_within`) makes necessary; None if
    nothing is demanded, or it is met.
    """
    from cellwright.engine.stages.fitting.datum_alignment import SURE_SIGMAS, count_further_looks

    within, datums = (
        inspection.aligned_within_m(problem),
        inspection.measured_datums(problem, measured),
    )
    places = [
        point.position for point in inspection.points_of_problem(inspection.with_places(problem))
    ]
    if within is None or datums is None or not places:
        return None
    sure = SURE_SIGMAS * float(alignment.sigma_at(np.array(places)).max())
    reason = f"the part is known to {1e3 * sure:.3g} mm, and has to be to {1e3 * within:.3g} mm"
    times = Counter(value.of for value in measured)
    values_left = MAX_DATUM_VALUES - max(times[name] for name in datums.names)
    looks = count_further_looks(
        alignment,
        datums,
        inspection.once_m(measured, datums.names),
        places,
        within,
        max(0, values_left),
    )
    if looks is None:
        most = f"{MAX_DATUM_VALUES} values of each datum are not enough for that"
        return DatumLooks(
            refused=f"{reason}; {most}: measure more datums, farther apart, or with a more exact "
            "tool"
        )
    return DatumLooks(looks, reason) if looks else None


def move_points(problem: Problem, lying: PartAlignment) -> Problem:
    """The problem with its points where the part lies."""
    return inspection.displace_problem(problem, lying.T)


def judge_features(
    problem: Problem,
    measured: Sequence[Measured],
    lying: PartAlignment | None,
    spoilt: Collection[Spoilt] = (),
) -> tuple[MeasuredFeature, ...]:
    """All features that were measured. Without any uncertainty there is nothing to judge."""
    if not any(value.uncertainty for value in measured):
        return ()
    return inspection.assess_features(problem, measured, lying, spoilt)


def facts_of(problem: Problem, names: Collection[str], facts: Collection[Atom]) -> list[Atom]:
    """The facts that say that these measurements are done."""
    words, places = (
        problem.domain.conventions,
        {problem.domain.conventions.place(name) for name in names},
    )
    return [f for f in facts if f.name == words.measured and str(f.arguments[-1]) in places]


def reopen_measurements(
    rest: Problem, tools: Mapping[str, str], facts: Collection[Atom]
) -> Problem:
    """The problem of measuring some points again, each by its tool if one is named, in a world
    in which they are not measured.
    """
    gone = set(facts_of(rest, tools, facts))
    goals = [
        _goal_by_tool(rest, part, tools)
        for part in goal_parts(rest.goal)
        if names_in_goal(part, tools)
    ]
    initial = tuple(atom for atom in rest.initial if atom not in gone)
    return replace(rest, initial=initial, goal=And(tuple(goals)), chains=())


def _goal_by_tool(rest: Problem, part: Condition, tools: Mapping[str, str]) -> Condition:
    """A goal with the tool that is named for its measurement."""
    tool = next((tools[name] for name in names_in_goal(part, tools)), "")
    inner = part.part if isinstance(part, Exists) else part
    if (
        not tool
        or not isinstance(inner, Literal)
        or inner.atom.name != rest.domain.conventions.measured
    ):
        return part
    first, *other_arguments = inner.atom.arguments
    literal = Literal(
        replace(inner.atom, arguments=(Function(tool), *other_arguments)), inner.positive
    )
    free = (
        tuple(parameter for parameter in part.parameters if parameter.variable != first)
        if isinstance(part, Exists)
        else ()
    )
    return Exists(free, literal) if free else literal


MAX_FEATURE_VALUES = 5  # values of one feature
# of those that could be decided, which are planned together
DECIDED_PORTIONS = (1.0, 0.5, 0.25, 0.1)


@dataclass(frozen=True, slots=True)
class Repeat:
    """Measurements that are made again, by name with the reason, and by which tools.

    `what` says how many, `why` what the planner found of it, `left` why others stay undecided.
    """

    names: Mapping[str, str] = field(default_factory=dict)
    tools: Mapping[str, str] = field(default_factory=dict)
    what: str = ""
    why: str = ""
    left: str = ""


def choose_repeats(
    problem: Problem,
    features: Sequence[MeasuredFeature],
    rest: Problem,
    limits: SearchLimits,
    facts: Collection[Atom],
) -> Repeat | None:
    """What is worth being measured again, in the world of `rest`; None if nothing is."""
    tried = {feature.of: len(feature.values) + len(feature.bad) for feature in features}
    doubtful = {
        feature.of: feature.doubt
        for feature in features
        if feature.doubt and tried[feature.of] < MAX_FEATURE_VALUES
    }
    undecided = [
        feature
        for feature in features
        if feature.conformity is Conformity.UNDECIDED and tried[feature.of] < MAX_FEATURE_VALUES
    ]
    best = _choose_decisive(problem, undecided, list(doubtful), rest, limits, facts)
    gain_of = {gain.feature.of: gain for gain in best.gains}
    if not doubtful and not gain_of:
        return Repeat(left=best.left) if best.left else None
    names = doubtful | {
        name: f"it is undecided; {_chance_text(gain)}" for name, gain in gain_of.items()
    }
    tools = {name: gain.offer.tool for name, gain in gain_of.items()}
    return Repeat(names, tools, _repeat_counts(doubtful, tools), best.why, best.left)


def _repeat_counts(doubtful: Mapping[str, str], tools: Mapping[str, str]) -> str:
    by = Counter(tools.values())
    parts = [f"{len(doubtful)} doubtful"] if doubtful else []
    return " and ".join(
        [*parts, *(f"{count} undecided with {tool}" for tool, count in sorted(by.items()))]
    )


@dataclass(frozen=True, slots=True)
class _Gain:
    """What another value of a feature by a tool is worth, in the domain's unit of time: the
    chance that it decides, by a decision's worth.
    """

    feature: MeasuredFeature
    offer: RemeasurementOffer
    chance: float

    @property
    def worth(self) -> float:
        """The worth of the value."""
        return self.offer.worth * self.chance


@dataclass(frozen=True, slots=True)
class _Choice:
    """Further values that gain most, why these, and why other features are left undecided."""

    gains: tuple[_Gain, ...] = ()
    why: str = ""
    left: str = ""


def _chance_text(gain: _Gain) -> str:
    return f"a value of {gain.offer.tool} decides with {gain.chance:.0%}"


def _choose_decisive(
    problem: Problem,
    undecided: Sequence[MeasuredFeature],
    doubtful: Sequence[str],
    rest: Problem,
    limits: SearchLimits,
    facts: Collection[Atom],
) -> _Choice:
    """The further values, and by which tools, that are worth most beyond the time that the
    planner needs for them.
    """
    gains = [gain for feature in undecided for gain in _feature_gains(problem, feature)]
    if not gains:
        return _Choice(
            left=f"{len(undecided)} undecided: no further value is worth anything"
            if undecided
            else ""
        )
    open_ = {name: "" for name in doubtful}
    base = _planned_time(rest, open_, limits, facts) if doubtful else 0.0
    tried = list[tuple[float, float, float, tuple[_Gain, ...]]]()  # net, worth, time
    for some in _value_sets(gains):
        lasts = _planned_time(
            rest, open_ | {gain.feature.of: gain.offer.tool for gain in some}, limits, facts
        )
        if lasts is not None and base is not None:
            worth = sum(gain.worth for gain in some)
            tried.append((worth - (lasts - base), worth, lasts - base, some))
    if not tried:
        return _Choice(left=f"{len(undecided)} undecided: there is no plan for further values")
    unit = problem.domain.time_unit
    best = max(tried, key=lambda candidate: candidate[0])
    texts = [
        f"{_by_tools(some)} takes {lasts:.0f} {unit} and is worth {worth:.0f} {unit}"
        for _, worth, lasts, some in tried
    ]
    if best[0] <= 0:
        return _Choice(left=f"{len(undecided)} undecided: {'; '.join(texts)}")
    other_texts = [
        text for text, candidate in zip(texts, tried, strict=True) if candidate is not best
    ]
    why = texts[tried.index(best)] + (f", but {'; '.join(other_texts)}" if other_texts else "")
    return _Choice(
        best[3],
        why,
        "" if len(best[3]) == len(undecided) else f"{len(undecided)} undecided: {'; '.join(texts)}",
    )


def _by_tools(gains: Sequence[_Gain]) -> str:
    by = Counter(gain.offer.tool for gain in gains)
    return " and ".join(f"{count} with {tool}" for tool, count in sorted(by.items()))


def _value_sets(gains: Sequence[_Gain]) -> list[tuple[_Gain, ...]]:
    """Sets of further values that are planned: by the tool that most probably decides each feature,
    and by one tool alone.

    Of each, those that are worth most: all, and portions.
    """
    likeliest = dict[str, _Gain]()
    for gain in sorted(gains, key=lambda value_gain: value_gain.worth):
        likeliest[gain.feature.of] = gain
    alone = [
        tuple(g for g in gains if g.offer.tool == tool)
        for tool in sorted({g.offer.tool for g in gains})
    ]
    sets = dict[tuple[tuple[str, str], ...], tuple[_Gain, ...]]()
    for gain_set in (tuple(likeliest.values()), *alone):
        order = sorted(gain_set, key=lambda member: (-member.worth, member.feature.of))
        for share in DECIDED_PORTIONS:
            some = tuple(order[: max(1, round(share * len(order)))])
            sets.setdefault(tuple(sorted((g.feature.of, g.offer.tool) for g in some)), some)
    return list(sets.values())


def _feature_gains(problem: Problem, feature: MeasuredFeature) -> list[_Gain]:
    """What a further value of a feature is worth, by each tool that may decide."""
    common = max(0.0, (feature.uncertainty or 0.0) ** 2 - _own_uncertainty(feature) ** 2) ** 0.5
    all_gains = [
        _Gain(feature, offer, chance_of_decision(feature, offer.uncertainty, common))
        for offer in remeasurement_offers(problem, feature)
    ]
    return [gain for gain in all_gains if gain.worth > 0]


def _own_uncertainty(feature: MeasuredFeature) -> float:
    """The part of a feature's expanded uncertainty that is of its values alone."""
    weights = sum(
        (COVERAGE_FACTOR / value.uncertainty) ** 2 for value in feature.values if value.uncertainty
    )
    return COVERAGE_FACTOR * float(weights**-0.5) if weights else 0.0


def _planned_time(
    rest: Problem, tools: Mapping[str, str], limits: SearchLimits, facts: Collection[Atom]
) -> float | None:
    """How long the planner needs to have measurements made again; None if there is no plan."""
    result = choose_and_plan(reopen_measurements(rest, tools, facts), limits, "")
    if not isinstance(result.outcome, Found):
        return None
    lasts = {step.id: step.duration for step in result.outcome.plan.steps}
    starts = result.starts or {}
    return float(max((starts.get(number, 0) + lasts[number] for number in lasts), default=0))
