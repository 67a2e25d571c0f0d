"""Pictures of tours: every visit and way is there, in the plane of the points; no colour stands
for two tools.
"""

import math
import re
from collections.abc import Sequence
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cellwright.engine.formats.report.drawing.colour_palette import assign_colours
from cellwright.engine.formats.report.drawing.tour_svg import (
    MAX_NAMED_VISITS,
    MAX_UPRIGHT_COSINE,
    TOOL_CHANGE_COLOUR,
    draw_tour,
)
from cellwright.engine.model.tour_problem import Tour, TourProblem, Visit

SVG = "{http://www.w3.org/2000/svg}"


def drawn(
    places: Sequence[Sequence[float]], tools: Sequence[str] = (), closed: bool = False
) -> str:
    """The picture of a tour through these places, in their order."""
    named = tools or [""] * len(places)
    visits = tuple(
        Visit(f"v{n}", tool=tool, position=tuple(place))
        for n, (place, tool) in enumerate(zip(places, named, strict=True))
    )
    problem = TourProblem(
        "tried", visits, np.zeros((len(visits), len(visits)), dtype=np.int64), closed=closed
    )
    found = draw_tour(Tour(tuple(range(len(visits))), 0, 0), problem)
    assert found is not None
    return found


def dots(text: str) -> np.ndarray:
    root = ElementTree.fromstring(text)
    circles = [each for each in root.iter(f"{SVG}circle") if each.get("class") == "visit"]
    return np.array([[float(each.get("cx", "")), float(each.get("cy", ""))] for each in circles])


@given(st.integers(0, 2**32 - 1), st.integers(3, 30))
def test_points_on_a_plane_keep_their_distances(seed: int, count: int) -> None:
    """However the plane stands in space, the picture has the distances of the points, on one
    scale.
    """
    random = np.random.default_rng(seed)
    turn, _ = np.linalg.qr(random.normal(size=(3, 3)))
    flat = random.uniform(-1, 1, size=(count, 3)) * np.array([1.0, 0.8, 0.0])
    places = flat @ turn + random.normal(size=3)
    seen = dots(drawn(places.tolist()))
    normal = np.cross(turn[0], turn[1])
    if abs(normal[2]) > MAX_UPRIGHT_COSINE:  # nearly level: seen from above
        places = places * np.array([1.0, 1.0, 0.0])
    real = np.linalg.norm(places[:, None] - places[None], axis=2)
    shown = np.linalg.norm(seen[:, None] - seen[None], axis=2)
    scale = shown.max() / real.max()
    assert np.abs(shown - scale * real).max() < 0.3


def test_an_upright_part_is_seen_from_the_origin_with_z_upwards() -> None:
    """A wall behind the y axis: what lies to the left of the arm lies left in the picture."""
    left_low, right_low, left_high = (2.0, 0.5, 1.0), (2.0, -0.5, 1.0), (2.0, 0.5, 1.6)
    seen = dots(drawn([left_low, right_low, left_high]))
    assert seen[0][0] < seen[1][0]
    assert seen[2][1] < seen[0][1]


@pytest.mark.parametrize("closed", [False, True])
def test_every_way_is_drawn_and_those_to_another_tool_are_marked(closed: bool) -> None:
    text = drawn([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], ["a", "a", "b", "b"], closed)
    ways = [
        each
        for each in ElementTree.fromstring(text).iter(f"{SVG}path")
        if each.get("class") == "way"
    ]
    assert len(ways) == 3 + closed
    assert [each.get("stroke") == TOOL_CHANGE_COLOUR for each in ways] == [
        False,
        True,
        False,
        True,
    ][: 3 + closed]


@pytest.mark.parametrize("count", [1, 2, MAX_NAMED_VISITS, MAX_NAMED_VISITS + 1])
def test_names_stand_beside_visits_unless_there_are_too_many(count: int) -> None:
    places = [(math.cos(n), math.sin(n) * n, 0.0) for n in range(count)]
    text = drawn(places)
    said = re.findall(r">(?:start |end )?(v\d+)</text>", text)
    assert set(said) == (
        {f"v{n}" for n in range(count)} if count <= MAX_NAMED_VISITS else {"v0", f"v{count - 1}"}
    )
    assert ("pointer" in text) == (count > MAX_NAMED_VISITS)


def test_visits_without_a_place_have_no_picture() -> None:
    problem = TourProblem("tried", (Visit("v"),), np.zeros((1, 1), dtype=np.int64))
    assert draw_tour(Tour((0,), 0, 0), problem) is None


@given(st.lists(st.text(max_size=4), max_size=300))
def test_no_colour_is_used_twice(names: list[str]) -> None:
    made = assign_colours(names)
    assert list(made) == list(dict.fromkeys(names))
    assert len(set(made.values())) == len(made)
    assert all(re.fullmatch("#[0-9a-f]{6}", each) for each in made.values())


def test_a_narrow_picture_is_as_wide_as_its_caption() -> None:
    text = drawn([(0.0, 0.0), (0.0, 1.0), (0.0, 2.0)])
    caption = next(line for line in re.findall(r">([^<>]+)</text>", text) if " tour of " in line)
    assert float(ElementTree.fromstring(text).get("width", "")) >= 6 * len(caption)
