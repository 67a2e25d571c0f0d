"""What an inspection does beside its plan: the part is found by its datums first, and what is doubtful or undecided is measured again.

A run whose problem has an alignment, and whose domain says how uncertain values are, first follows its plan as far as the last
datum. Then it is found out where the part lies, and all that is left is planned for the part as it lies. At the end of the plan
bad values are looked for; they are repeated. A decision that further values may bring is worth so much time as the domain says: the
planner says how long they take.
"""

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

from engine.model.fits import Alignment, Unaligned
from engine.model.measurements import chooses_tools, named
from engine.model.outcome import Found
from engine.model.verdicts import Feature, Spoilt
from engine.pipelines.execution.planned import Ready
from engine.pipelines.execution.scope import Scope
from engine.pipelines.execution.toplevel import made
from engine.pipelines.measuring import Measuring
from engine.pipelines.verdicts.lying import Lying
from engine.pipelines.verdicts.offers import Offer, offers
from engine.pipelines.verdicts.worth import chance_of_decision
from engine.stages.planning import Limits
from kb.model.conditions import And, Condition, Exists, Literal, goal_parts
from kb.model.conformity import COVERAGE, Conformity
from kb.model.plan import Plan
from kb.model.problem import Problem
from kb.model.results import Measured
from kb.terms import Atom, Function

MOST = 5  # values of one feature
LOOKS = 12  # values of one datum
PORTIONS = (
    1.0,
    0.5,
    0.25,
    0.1,
)  # of those that could be decided, the likeliest first, which are planned together


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


def datums_asked(problem: Problem) -> tuple[str, ...]:
    """The datums that are to be measured before everything else; none if the run does not find the part by itself."""
    if (
        not chooses_tools(problem.domain)
        or problem.domain.conventions.alignment not in problem.domain.predicates
    ):
        return ()
    from engine.pipelines.verdicts.lying import alignment_asked  # it needs numpy

    return alignment_asked(problem)


def first_stage(ready: Ready, scope: Scope) -> tuple[Plan, Scope] | None:
    """The steps of a plan up to its last datum, and their goals; None if the part is not to be found, or the plan has not all datums."""
    asked, measuring = set(datums_asked(scope.problem)), Measuring(scope.problem)
    if not asked:
        return None
    told = [(n, measuring.expected(step.operator)) for n, step in enumerate(ready.plan.steps)]
    mine = {each.of: n for n, each in told if each is not None and each.of in asked and each.uncertainty}
    if set(mine) != asked:
        return None
    steps = ready.plan.steps[: max(mine.values()) + 1]
    goals = [str(part) for part in goal_parts(scope.problem.goal) if named(part, asked)]
    return Plan(steps), scope.cut({}, goals)


def located(problem: Problem, measured: Sequence[Measured]) -> tuple[tuple[str, ...], Alignment | Unaligned]:
    """The datums, and where the part lies by their last values, or why it fits nowhere."""
    from engine.pipelines.verdicts.lying import measured_datums
    from engine.stages.fitting.alignment import aligned

    datums = measured_datums(problem, measured)
    if datums is None:
        return (), Unaligned("not all datums were measured")
    return datums.names, aligned(datums)


@dataclass(frozen=True, slots=True)
class Looks:
    """Datums that are measured again before the part counts as found, with how often; `refused` says why that would not do."""

    names: Mapping[str, int] = field(default_factory=dict)
    told: str = ""
    refused: str = ""


def looks_needed(problem: Problem, measured: Sequence[Measured], found: Alignment) -> Looks | None:
    """What a demand on how well the part is known (`aligned_within`) makes necessary; None if nothing is demanded, or it is met."""
    import numpy as np

    from engine.pipelines.points import points, with_places
    from engine.pipelines.verdicts.lying import aligned_within_m, measured_datums, once_m
    from engine.stages.fitting.looks import SURE, further_looks

    within, datums = aligned_within_m(problem), measured_datums(problem, measured)
    places = [point.position for point in points(with_places(problem))]
    if within is None or datums is None or not places:
        return None
    sure = SURE * float(found.sigma_at(np.array(places)).max())
    told = f"the part is known to {1e3 * sure:.3g} mm, and has to be to {1e3 * within:.3g} mm"
    times = Counter(each.of for each in measured)
    left = LOOKS - max(times[name] for name in datums.names)
    looks = further_looks(found, datums, once_m(measured, datums.names), places, within, max(0, left))
    if looks is None:
        most = f"{LOOKS} values of each datum are not enough for that"
        return Looks(refused=f"{told}; {most}: measure more datums, farther apart, or with a more exact tool")
    return Looks(looks, told) if looks else None


def moved(problem: Problem, lying: Lying) -> Problem:
    """The problem with its points where the part lies."""
    from engine.pipelines.verdicts.lying import displaced

    return displaced(problem, lying.T)


def judged(
    problem: Problem, measured: Sequence[Measured], lying: Lying | None, spoilt: Collection[Spoilt] = ()
) -> tuple[Feature, ...]:
    """All features that were measured. Without any uncertainty there is nothing to judge."""
    if not any(each.uncertainty for each in measured):
        return ()
    from engine.pipelines.verdicts.assessing import assessed

    return assessed(problem, measured, lying, spoilt)


def facts_of(problem: Problem, names: Collection[str], facts: Collection[Atom]) -> list[Atom]:
    """The facts that say that these measurements are done."""
    words, places = problem.domain.conventions, {problem.domain.conventions.place(each) for each in names}
    return [f for f in facts if f.name == words.measured and str(f.arguments[-1]) in places]


def repeats(
    problem: Problem, features: Sequence[Feature], rest: Problem, limits: Limits, facts: Collection[Atom]
) -> Repeat | None:
    """What is worth being measured again, in the world of `rest`; None if nothing is."""
    tried = {each.of: len(each.values) + len(each.bad) for each in features}
    doubtful = {each.of: each.doubt for each in features if each.doubt and tried[each.of] < MOST}
    undecided = [
        each for each in features if each.conformity is Conformity.UNDECIDED and tried[each.of] < MOST
    ]
    best = _decisive(problem, undecided, list(doubtful), rest, limits, facts)
    found = {each.feature.of: each for each in best.gains}
    if not doubtful and not found:
        return Repeat(left=best.left) if best.left else None
    names = doubtful | {name: f"it is undecided; {_chance(each)}" for name, each in found.items()}
    tools = {name: each.offer.tool for name, each in found.items()}
    return Repeat(names, tools, _told(doubtful, tools), best.why, best.left)


def _told(doubtful: Mapping[str, str], tools: Mapping[str, str]) -> str:
    by = Counter(tools.values())
    parts = [f"{len(doubtful)} doubtful"] if doubtful else []
    return " and ".join([*parts, *(f"{count} undecided with {tool}" for tool, count in sorted(by.items()))])


@dataclass(frozen=True, slots=True)
class _Gain:
    """What another value of a feature by a tool is worth, in the domain's unit of time: the chance that it decides, by a decision's worth."""

    feature: Feature
    offer: Offer
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


def _chance(gain: _Gain) -> str:
    return f"a value of {gain.offer.tool} decides with {gain.chance:.0%}"


def _decisive(
    problem: Problem,
    undecided: Sequence[Feature],
    doubtful: Sequence[str],
    rest: Problem,
    limits: Limits,
    facts: Collection[Atom],
) -> _Choice:
    """The further values, and by which tools, that are worth most beyond the time that the planner needs for them."""
    gains = [gain for feature in undecided for gain in _gains(problem, feature)]
    if not gains:
        return _Choice(
            left=f"{len(undecided)} undecided: no further value is worth anything" if undecided else ""
        )
    open_ = {name: "" for name in doubtful}
    base = _takes(rest, open_, limits, facts) if doubtful else 0.0
    tried = list[tuple[float, float, float, tuple[_Gain, ...]]]()  # net, worth, time
    for some in _ways(gains):
        lasts = _takes(rest, open_ | {each.feature.of: each.offer.tool for each in some}, limits, facts)
        if lasts is not None and base is not None:
            worth = sum(each.worth for each in some)
            tried.append((worth - (lasts - base), worth, lasts - base, some))
    if not tried:
        return _Choice(left=f"{len(undecided)} undecided: there is no plan for further values")
    unit = problem.domain.time_unit
    best = max(tried, key=lambda each: each[0])
    said = [
        f"{_by_tools(some)} takes {lasts:.0f} {unit} and is worth {worth:.0f} {unit}"
        for _, worth, lasts, some in tried
    ]
    if best[0] <= 0:
        return _Choice(left=f"{len(undecided)} undecided: {'; '.join(said)}")
    others = [each for each, one in zip(said, tried, strict=True) if one is not best]
    why = said[tried.index(best)] + (f", but {'; '.join(others)}" if others else "")
    return _Choice(
        best[3],
        why,
        "" if len(best[3]) == len(undecided) else f"{len(undecided)} undecided: {'; '.join(said)}",
    )


def _by_tools(gains: Sequence[_Gain]) -> str:
    by = Counter(each.offer.tool for each in gains)
    return " and ".join(f"{count} with {tool}" for tool, count in sorted(by.items()))


def _ways(gains: Sequence[_Gain]) -> list[tuple[_Gain, ...]]:
    """Sets of further values that are planned: by the tool that most probably decides each feature, and by one tool alone.

    Of each, those that are worth most: all, and portions.
    """
    likeliest = dict[str, _Gain]()
    for each in sorted(gains, key=lambda one: one.worth):
        likeliest[each.feature.of] = each
    alone = [
        tuple(g for g in gains if g.offer.tool == tool) for tool in sorted({g.offer.tool for g in gains})
    ]
    found = dict[tuple[tuple[str, str], ...], tuple[_Gain, ...]]()
    for way in (tuple(likeliest.values()), *alone):
        order = sorted(way, key=lambda each: (-each.worth, each.feature.of))
        for share in PORTIONS:
            some = tuple(order[: max(1, round(share * len(order)))])
            found.setdefault(tuple(sorted((g.feature.of, g.offer.tool) for g in some)), some)
    return list(found.values())


def _gains(problem: Problem, feature: Feature) -> list[_Gain]:
    """What a further value of a feature is worth, by each tool that may decide."""
    common = max(0.0, (feature.uncertainty or 0.0) ** 2 - _own(feature) ** 2) ** 0.5
    each = [
        _Gain(feature, offer, chance_of_decision(feature, offer.uncertainty, common))
        for offer in offers(problem, feature)
    ]
    return [one for one in each if one.worth > 0]


def _own(feature: Feature) -> float:
    """The part of a feature's expanded uncertainty that is of its values alone."""
    weights = sum((COVERAGE / each.uncertainty) ** 2 for each in feature.values if each.uncertainty)
    return COVERAGE * float(weights**-0.5) if weights else 0.0


def _takes(rest: Problem, tools: Mapping[str, str], limits: Limits, facts: Collection[Atom]) -> float | None:
    """How long the planner needs to have measurements made again; None if there is no plan."""
    found = made(reopened(rest, tools, facts), limits, "")
    if not isinstance(found.outcome, Found):
        return None
    lasts = {step.id: step.duration for step in found.outcome.plan.steps}
    starts = found.starts or {}
    return float(max((starts.get(each, 0) + lasts[each] for each in lasts), default=0))


def reopened(rest: Problem, tools: Mapping[str, str], facts: Collection[Atom]) -> Problem:
    """The problem of measuring some points again, each by its tool if one is named, in a world in which they are not measured."""
    gone = set(facts_of(rest, tools, facts))
    goals = [_by(rest, part, tools) for part in goal_parts(rest.goal) if named(part, tools)]
    initial = tuple(each for each in rest.initial if each not in gone)
    return replace(rest, initial=initial, goal=And(tuple(goals)), chains=())


def _by(rest: Problem, part: Condition, tools: Mapping[str, str]) -> Condition:
    """A goal with the tool that is named for its measurement."""
    tool = next((tools[name] for name in named(part, tools)), "")
    inner = part.part if isinstance(part, Exists) else part
    if not tool or not isinstance(inner, Literal) or inner.atom.name != rest.domain.conventions.measured:
        return part
    first, *others = inner.atom.arguments
    told = Literal(replace(inner.atom, arguments=(Function(tool), *others)), inner.positive)
    free = (
        tuple(each for each in part.parameters if each.variable != first) if isinstance(part, Exists) else ()
    )
    return Exists(free, told) if free else told
