"""What an inspection does beside its plan: the part is found by its datums first, and what is doubtful or undecided is measured again.

A run whose problem has an alignment, and whose domain says how uncertain values are, first follows its plan as far as the last
datum. Then it is found out where the part lies, and all that is left is planned for the part as it lies. At the end of the plan
bad values are looked for; they are repeated. A decision that further values may bring is worth so much time as the domain says: the
planner says how long they take.
"""

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

from cellwright.engine.model.fits import Alignment, Unaligned
from cellwright.engine.model.measurements import chooses_tools, named
from cellwright.engine.model.verdicts import Feature, Spoilt
from cellwright.engine.pipelines.execution.planned import Ready
from cellwright.engine.pipelines.execution.scope import Scope
from cellwright.engine.pipelines.measuring import Measuring
from cellwright.engine.pipelines.verdicts.lying import Lying
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.model.conditions import And, Condition, Exists, Literal, goal_parts
from cellwright.kb.model.plan import Plan
from cellwright.kb.model.problem import Problem
from cellwright.kb.model.results import Measured
from cellwright.kb.terms import Atom, Function

LOOKS = 12  # values of one datum
HELPERS = 3  # points that a hint names


def datums_asked(problem: Problem) -> tuple[str, ...]:
    """The datums that are to be measured before everything else; none if the run does not find the part by itself."""
    if (
        not chooses_tools(problem.domain)
        or problem.domain.conventions.alignment not in problem.domain.predicates
    ):
        return ()
    from cellwright.engine.pipelines.verdicts.lying import alignment_asked  # it needs numpy

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
    _require_held(scope.problem)
    steps = ready.plan.steps[: max(mine.values()) + 1]
    goals = [str(part) for part in goal_parts(scope.problem.goal) if named(part, asked)]
    return Plan(steps), scope.cut({}, goals)


def _require_held(problem: Problem) -> None:
    """Refuse datums that cannot show where the part lies, however well they are measured, and name points that would help."""
    from cellwright.engine.pipelines.verdicts.lying import datum_points, datums, profiles
    from cellwright.engine.stages.fitting.alignment import holding, lacking

    asked = datum_points(problem)
    planned = datums([(point, 0.0) for point in asked.values()], [1.0] * len(asked))
    reason = lacking(planned)
    if reason is None:
        return
    others = [(point, 0.0) for name, point in profiles(problem).items() if name not in asked]
    best = holding(planned, datums(others, [1.0] * len(others))) if others else ()
    word, last = problem.domain.conventions.alignment, max(point.step for point in asked.values())
    facts = ", ".join(f"{word}({name}, {last})" for name in best[:HELPERS])
    hint = f"add more, such as {facts}" if facts else "add points that hold it"
    raise InvalidInput([Diagnostic(Source(problem.path), "K421", reason, f"{hint}, to `statics`")])


def located(problem: Problem, measured: Sequence[Measured]) -> tuple[tuple[str, ...], Alignment | Unaligned]:
    """The datums, and where the part lies by their last values, or why it fits nowhere."""
    from cellwright.engine.pipelines.verdicts.lying import measured_datums
    from cellwright.engine.stages.fitting.alignment import aligned

    datums = measured_datums(problem, measured)
    if datums is None:
        return (), Unaligned("not all datums were measured")
    return datums.names, aligned(datums)


@dataclass(frozen=True, slots=True)
class Looks:
    """Datums that are measured again before the part counts as found, with how often; `refused` says why measuring again is not enough."""

    names: Mapping[str, int] = field(default_factory=dict)
    told: str = ""
    refused: str = ""


def looks_needed(problem: Problem, measured: Sequence[Measured], found: Alignment) -> Looks | None:
    """What a demand on how well the part is known (`aligned_within`) makes necessary; None if nothing is demanded, or it is met."""
    import numpy as np

    from cellwright.engine.pipelines.points import points, with_places
    from cellwright.engine.pipelines.verdicts.lying import aligned_within_m, measured_datums, once_m
    from cellwright.engine.stages.fitting.looks import SURE, further_looks

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
    from cellwright.engine.pipelines.verdicts.lying import displaced

    return displaced(problem, lying.T)


def judged(
    problem: Problem, measured: Sequence[Measured], lying: Lying | None, spoilt: Collection[Spoilt] = ()
) -> tuple[Feature, ...]:
    """All features that were measured. Without any uncertainty there is nothing to judge."""
    if not any(each.uncertainty for each in measured):
        return ()
    from cellwright.engine.pipelines.verdicts.assessing import assessed

    return assessed(problem, measured, lying, spoilt)


def facts_of(problem: Problem, names: Collection[str], facts: Collection[Atom]) -> list[Atom]:
    """The facts that say that these measurements are done."""
    words, places = problem.domain.conventions, {problem.domain.conventions.place(each) for each in names}
    return [f for f in facts if f.name == words.measured and str(f.arguments[-1]) in places]


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
