"""What an inspection measures again at the end of its plan, and with which tool: what is in doubt, and what is worth deciding."""

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field

from cellwright.engine.model.outcome import Found
from cellwright.engine.model.verdicts import Feature
from cellwright.engine.pipelines.execution.inspecting import reopened
from cellwright.engine.pipelines.execution.toplevel import made
from cellwright.engine.pipelines.verdicts.offers import Offer, offers
from cellwright.engine.pipelines.verdicts.worth import chance_of_decision
from cellwright.engine.stages.planning import Limits
from cellwright.kb.model.conformity import COVERAGE, Conformity
from cellwright.kb.model.problem import Problem
from cellwright.kb.terms import Atom

MOST = 5  # values of one feature
PORTIONS = (1.0, 0.5, 0.25, 0.1)  # of those that could be decided, which are planned together


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
