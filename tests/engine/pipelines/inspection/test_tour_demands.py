"""Windows, durations and precedence of measurements: from facts and from options, against plain
reading.
"""

from dataclasses import replace
from pathlib import Path

import pytest

from cellwright.engine.authoring import domain_check
from cellwright.engine.model.tour_problem import (
    Tour,
    TourProblem,
    slack_of,
    times_of,
    tour_violations,
)
from cellwright.engine.pipelines.inspection.measurement_points import with_places
from cellwright.engine.pipelines.inspection.tool_tours import partition_by_tool, tour_problem
from cellwright.engine.pipelines.inspection.tour_demands import (
    TourDemands,
    of_options,
    require_known_visits,
)
from cellwright.engine.stages.sequencing import sequence_tour
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.loader import load
from cellwright.kb.model.planning_problem import Problem

POINTS = """problem: pieces
domain: bulkhead
objects:
  measurement: [m1..4]
statics:
  - needs(m1, thickness), needs(m2, thickness), needs(m3, thickness), needs(m4, thickness)
  - position(m1, 0, 0, 0), position(m2, 100000, 0, 0), position(m3, 200000, 0, 0), position(m4, 300000, 0, 0)
"""
END = (
    "initial:\n  - at(t3_746, approach_point(rack(us_probe)))\ngoals:\n  - measured(_, _, "
    "meas(m1))\n"
)


def problem_with(folder: Path, facts: str) -> Problem:
    file = folder / "pieces.yaml"
    file.write_text(POINTS + (f"  - {facts}\n" if facts else "") + END, encoding="utf-8")
    found = load(file).problem
    assert found is not None
    return with_places(found)


def tours_of(problem: Problem, demands: TourDemands = TourDemands()) -> TourProblem:
    return tour_problem(problem, partition_by_tool(problem), demands)


def names(tours: TourProblem, answer: object) -> list[str]:
    assert isinstance(answer, Tour)
    assert tour_violations(tours, answer.order) == []
    return [tours.visits[each].name for each in answer.order]


def test_precedence_of_facts_is_kept_and_costs_stay_lengths(tmp_path: Path) -> None:
    tours = tours_of(problem_with(tmp_path, "before(m4, m3), before(m3, m2), before(m2, m1)"))
    assert tours.unit == "µm"
    assert names(tours, sequence_tour(tours)) == ["m4", "m3", "m2", "m1"]


def test_windows_and_durations_make_costs_times(tmp_path: Path) -> None:
    tours = tours_of(
        problem_with(tmp_path, "window(m4, 0, 1), window(m1, 500, 600), lasts(m4, 20)")
    )
    order = names(tours, sequence_tour(tours))
    assert (order[0], order[-1], tours.unit) == ("m4", "m1", "s")
    assert times_of(tours, tuple(int(name[1]) - 1 for name in order))[-1][1] == 500


def test_options_speak_louder_than_facts_and_facts_stay_beside_them(tmp_path: Path) -> None:
    problem = problem_with(tmp_path, "window(m4, 0, 1), before(m3, m2)")
    demands = of_options(["m4=900..", "m1=..5"], ["m1=3, m2=4"], ["m1,m2"])
    tours = tours_of(problem, demands)
    windows = {visit.name: visit.window for visit in tours.visits}
    assert windows["m1"] == (0, 5)
    assert windows["m4"] is not None
    assert windows["m4"][0] == 900
    assert [visit.duration for visit in tours.visits] == [3, 4, 0, 0]
    assert {(tours.visits[a].name, tours.visits[b].name) for a, b in tours.precedence} == {
        ("m3", "m2"),
        ("m1", "m2"),
    }


@pytest.mark.parametrize(
    "option", ["m3", "m3=", "m3=..", "=1..2", "m3=4..2", "m3=a..b", "m3=-1..2"]
)
def test_windows_that_cannot_be_read_are_refused(option: str) -> None:
    with pytest.raises(InvalidInput, match="K406"):
        of_options([option], [], [])


@pytest.mark.parametrize("before", ["m1", "m1,m1", "m1,,m2", ""])
def test_orders_that_cannot_be_read_are_refused(before: str) -> None:
    with pytest.raises(InvalidInput, match="K406"):
        of_options([], [], [before])


def test_an_option_about_no_visit_is_refused() -> None:
    with pytest.raises(InvalidInput, match="K101"):
        require_known_visits(of_options([], ["m9=1"], []), {"m1"})


@pytest.mark.parametrize(
    ("facts", "said"),
    [
        ("window(m1, 9, 3)", "window of m1 is 9, 3"),
        ("window(m1, 0, 3), window(m1, 0, 4)", "two values of window"),
        ("before(m1, m2), before(m2, m3), before(m3, m1)", "before forms a cycle"),
    ],
)
def test_check_tells_what_no_tour_can_keep(tmp_path: Path, facts: str, said: str) -> None:
    problem_with(tmp_path, facts)
    told = domain_check.check_domain_files(str(tmp_path / "pieces.yaml"), reach=False).diagnostics
    assert [each.code for each in told if said in each.message] == ["K115"]


def test_windows_need_a_declared_travel(tmp_path: Path) -> None:
    problem = problem_with(tmp_path, "window(m1, 0, 9)")
    with pytest.raises(InvalidInput, match="K405"):
        tours_of(replace(problem, domain=replace(problem.domain, motion=None)))


def test_slack_is_what_the_later_windows_leave(tmp_path: Path) -> None:
    tours = tours_of(
        problem_with(tmp_path, "window(m2, 0, 50), window(m3, 100, 130), lasts(m1, 7)")
    )
    order = (0, 1, 2, 3)
    begins = [begin for _, begin in times_of(tours, order)]
    for place, slack in enumerate(slack_of(tours, order)[:3]):
        late = replace(
            tours.visits[order[place]], window=(begins[place] + slack, begins[place] + slack)
        )
        shifted = [
            late if each == order[place] else visit for each, visit in enumerate(tours.visits)
        ]
        assert tour_violations(replace(tours, visits=tuple(shifted)), order) == []
        later = replace(late, window=(begins[place] + slack + 1, begins[place] + slack + 1))
        shifted[order[place]] = later
        kept = [each for each in tour_violations(replace(tours, visits=tuple(shifted)), order)]
        assert kept or begins[place] + slack + 1 > (tours.visits[order[place]].window or (0, 0))[1]
