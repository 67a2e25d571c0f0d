"""What a run has shown of a part, from its results and its journal: coverage, verdicts, and where the part lay."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Any

from cellwright.engine.model.measurements import chooses_tools, measurements_of, wanted
from cellwright.engine.model.verdicts import Spoilt, Survey, Unmeasured
from cellwright.engine.pipelines.points import points, with_places
from cellwright.engine.pipelines.verdicts.assessing import assessed
from cellwright.engine.pipelines.verdicts.lying import lying_in
from cellwright.kb.model.problem import Problem
from cellwright.kb.model.results import Results

Content = Mapping[str, Any]


def survey(
    problem: Problem,
    results: Results,
    alignments: Iterable[tuple[Content, int]] = (),
    given_up: Iterable[tuple[str, str]] = (),
    impossible: Mapping[str, str] | None = None,
    spoilt: Collection[Spoilt] = (),
    again: Mapping[str, Sequence[str]] = MappingProxyType({}),
) -> Survey | None:
    """The survey of a run; None for a problem without measurements.

    `alignments` are its records about where the part lies, each with its time, the last one last. `given_up` are goals with reasons,
    `impossible` measurements that no tool can take, `spoilt` values that were found not to count,
    `again` why measurements were made again.
    """
    if not chooses_tools(problem.domain):
        return None
    found, refused = lying_in(alignments)
    judged = assessed(problem, results.measured, found, spoilt)
    features = tuple(replace(each, again=tuple(again.get(each.of, ()))) for each in judged)
    done = {each.of for each in features}
    why = _reasons(problem, given_up, impossible or {})
    missing = tuple(Unmeasured(name, said) for name, said in why.items() if name not in done)
    places = {point.name: point.position for point in points(with_places(problem))}
    if found is None:
        return Survey(features, missing, places, refused=refused)
    part = tuple(float(each) for each in found.T[:3].ravel())
    return Survey(features, missing, places, part, found.datums, found.wrong)


def _reasons(
    problem: Problem, given_up: Iterable[tuple[str, str]], impossible: Mapping[str, str]
) -> dict[str, str]:
    """Why each measurement is not made if it is not made; those that goals ask for come first."""
    asked, names = wanted(problem), measurements_of(problem)
    found = {name: "the run has not come to it" for name in names if name in asked}
    found |= {name: "no goal asks for it" for name in names if name not in asked}
    words = problem.domain.conventions
    for goal, why in given_up:
        found |= {name: why for name in found if f"{words.place(name)}" in goal}
    return found | {name: why for name, why in impossible.items() if name in found}
