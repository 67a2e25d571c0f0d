"""Relations between features give the poses that a hand computes, and tell what is free, said
twice or contradictory.
"""

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.kernels.rigid import apply, rotation_by_vector
from cellwright.engine.model.manipulation_values import (
    Assembled,
    FeatureKind,
    PartFeature,
    Relation,
    RelationContradiction,
    RelationKind,
)
from cellwright.engine.stages.assembly.part_assembly import assemble_parts

K = RelationKind
AXES = {
    "x": (1, 0, 0),
    "y": (0, 1, 0),
    "z": (0, 0, 1),
    "-x": (-1, 0, 0),
    "-y": (0, -1, 0),
    "-z": (0, 0, -1),
}


def plane(part: str, name: str, normal: str, height: float) -> PartFeature:
    """A face of a part, square to an axis, `height` outside the origin."""
    direction = np.array(AXES[normal], dtype=float)
    return PartFeature(part, name, FeatureKind.PLANE, direction * height, direction)


def line(part: str, name: str, along: str, point: tuple[float, float, float]) -> PartFeature:
    """An axis of a part."""
    return PartFeature(
        part, name, FeatureKind.LINE, np.array(point), np.array(AXES[along], dtype=float)
    )


def point(part: str, name: str, at: tuple[float, float, float]) -> PartFeature:
    """A vertex of a part."""
    return PartFeature(part, name, FeatureKind.POINT, np.array(at), np.zeros(3))


def assembled(*relations: Relation, starts: dict[str, Floats] | None = None) -> Assembled:
    """The poses of the parts on part b."""
    found = assemble_parts(relations, "b", starts)
    assert isinstance(found, Assembled)
    return found


BOTTOM, TOP = plane("a", "bottom", "-z", 0.02), plane("b", "top", "z", 0.05)
LEFT, WALL = plane("a", "left", "-x", 0.03), plane("b", "wall", "x", 0.01)
FRONT, STOP = plane("a", "front", "-y", 0.04), plane("b", "stop", "y", 0.07)
BLOCK_IN_CORNER = [
    Relation(K.AGAINST, BOTTOM, TOP),
    Relation(K.AGAINST, LEFT, WALL),
    Relation(K.AGAINST, FRONT, STOP),
]


def test_three_faces_against_a_corner_leave_no_freedom() -> None:
    found = assembled(*BLOCK_IN_CORNER)
    assert found.degrees == 0
    assert not found.redundant
    expected = np.eye(4)
    expected[:3, 3] = 0.04, 0.11, 0.07
    np.testing.assert_allclose(found.poses["a"], expected, atol=1e-12)


def test_a_face_on_a_table_leaves_two_slides_and_a_turn() -> None:
    found = assembled(BLOCK_IN_CORNER[0])
    assert found.degrees == 3
    pitches = [each.pitch_m for each in found.freedoms]
    assert pitches == [np.inf, np.inf, 0.0]
    assert abs(found.freedoms[2].direction[2]) == pytest.approx(1.0)


def test_a_peg_in_a_hole_turns_and_slides_until_its_shoulder_stops_it() -> None:
    peg, hole = line("a", "axis", "-z", (0.01, 0, 0)), line("b", "hole", "z", (0.2, 0.1, 0))
    fitted = assembled(Relation(K.FITS, peg, hole))
    assert [each.pitch_m for each in fitted.freedoms] == [np.inf, 0.0]
    seated = assembled(Relation(K.FITS, peg, hole), Relation(K.AGAINST, BOTTOM, TOP))
    (turn,) = seated.freedoms
    assert turn.pitch_m == 0.0
    np.testing.assert_allclose(turn.point[:2], (0.2, 0.1), atol=1e-9)


def test_the_preferred_value_decides_what_is_free() -> None:
    wish = Relation(K.ANGLE, plane("a", "left", "-x", 0.03), WALL, np.radians(30), preferred=True)
    pegged = Relation(K.FITS, line("a", "axis", "-z", (0, 0, 0)), line("b", "hole", "z", (0, 0, 0)))
    found = assembled(pegged, Relation(K.AGAINST, BOTTOM, TOP), wish)
    normal = found.poses["a"][:3, :3] @ wish.first.direction
    assert normal @ WALL.direction == pytest.approx(np.cos(np.radians(30)), abs=1e-9)
    assert found.degrees == 1


def test_a_preferred_value_yields_to_what_must_hold() -> None:
    wish = Relation(K.DISTANCE, BOTTOM, TOP, 0.3, preferred=True)
    found = assembled(*BLOCK_IN_CORNER, wish)
    np.testing.assert_allclose(found.poses["a"][:3, 3], (0.04, 0.11, 0.07), atol=1e-9)


def test_what_is_said_twice_is_named() -> None:
    again = Relation(K.PARALLEL, LEFT, WALL)
    assert assembled(*BLOCK_IN_CORNER, again).redundant == (again,)


def test_parallel_does_not_follow_from_itself_when_a_sense_matters() -> None:
    assert not assembled(Relation(K.COPLANAR, BOTTOM, TOP)).redundant


def test_the_smallest_contradiction_is_named() -> None:
    found = assemble_parts([*BLOCK_IN_CORNER, Relation(K.DISTANCE, BOTTOM, TOP, 0.01)], "b")
    assert isinstance(found, RelationContradiction)
    assert {str(each) for each in found.relations} == {
        "a.bottom against b.top",
        "a.bottom distance b.top",
    }


@pytest.mark.slow
def test_a_contradiction_may_run_through_several_parts() -> None:
    lid = plane("c", "lid", "-z", 0.0)
    relations = [
        *BLOCK_IN_CORNER,
        Relation(K.AGAINST, lid, plane("a", "top", "z", 0.02)),
        Relation(K.DISTANCE, lid, TOP, 0.05),
        Relation(K.PARALLEL, plane("c", "side", "x", 0.1), WALL),
    ]
    found = assemble_parts(relations, "b")
    assert isinstance(found, RelationContradiction)
    assert set(found.relations) == {relations[0], relations[3], relations[4]}


def test_three_distances_from_points_leave_two_mirror_images() -> None:
    corners = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]
    ball = point("a", "centre", (0, 0, 0))
    said = [Relation(K.DISTANCE, ball, point("b", f"p{n}", c), 1.0) for n, c in enumerate(corners)]
    found = assembled(*said)
    assert found.degrees == 3  # the ball still turns
    assert sorted(each.pitch_m for each in found.freedoms) == [0.0, 0.0, 0.0]


def test_a_touching_distance_has_no_freedom_that_derivatives_alone_would_promise() -> None:
    peg = point("a", "tip", (0, 0, 0))
    squared = [
        Relation(K.PARALLEL, plane("a", "x", "x", 0.0), WALL),
        Relation(K.PARALLEL, plane("a", "y", "y", 0.0), STOP),
        Relation(K.DISTANCE, peg, point("b", "p", (-1, 0, 0)), 1.0),
        Relation(K.DISTANCE, peg, point("b", "q", (1, 0, 0)), 1.0),
    ]
    assert assembled(*squared).degrees == 0


def test_features_that_do_not_go_together_are_refused() -> None:
    with pytest.raises(ValueError, match="fits does not join a plane and a plane"):
        assemble_parts([Relation(K.FITS, BOTTOM, TOP)], "b")
    with pytest.raises(ValueError, match="both features are on a"):
        assemble_parts([Relation(K.PARALLEL, BOTTOM, LEFT)], "b")


def rotations() -> st.SearchStrategy[Floats]:
    """Rotation matrices of all directions."""
    return st.tuples(*[st.floats(-3, 3)] * 3).map(lambda v: rotation_by_vector(np.array(v)))


@st.composite
def consistent(draw: st.DrawFn) -> tuple[Floats, list[Relation]]:
    """A pose, and relations that hold there between drawn features and determine it."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = draw(rotations()), draw(st.tuples(*[st.floats(-0.5, 0.5)] * 3))
    frame, relations = draw(rotations()), []
    lengths = draw(st.lists(st.floats(-0.2, 0.2), min_size=3, max_size=3))
    senses = draw(st.lists(st.sampled_from([K.AGAINST, K.COPLANAR]), min_size=3, max_size=3))
    for n, (length, kind) in enumerate(zip(lengths, senses, strict=True)):
        normal = frame[:, n] if n else (frame[:, 0] + frame[:, 1]) / np.sqrt(2)
        own = PartFeature("a", f"f{n}", FeatureKind.PLANE, length * normal, normal)
        outward = T[:3, :3] @ normal
        at = apply(T, own.point[None])[0] + np.cross(outward, (0.1, 0.2, 0.3))
        other = PartFeature(
            "b", f"g{n}", FeatureKind.PLANE, at, -outward if kind is K.AGAINST else outward
        )
        relations.append(Relation(kind, own, other))
    return T, relations


@settings(max_examples=12, deadline=None)
@given(said=consistent())
def test_a_transform_is_recovered_from_relations_that_determine_it(
    said: tuple[Floats, list[Relation]],
) -> None:
    T, relations = said
    found = assembled(*relations)
    assert found.degrees == 0
    np.testing.assert_allclose(found.poses["a"], T, atol=1e-9)


@settings(max_examples=2, deadline=None)
@given(
    said=consistent(),
    shifts=st.lists(st.floats(0.05, 0.3), min_size=2, max_size=2),
    at=st.integers(0, 2),
)
def test_no_smaller_set_of_a_contradiction_contradicts_itself(
    said: tuple[Floats, list[Relation]], shifts: list[float], at: int
) -> None:
    _, relations = said
    wrong = relations[at]
    extra = [Relation(K.DISTANCE, wrong.first, wrong.second, shift) for shift in shifts]
    found = assemble_parts([*relations, *extra], "b")
    assert isinstance(found, RelationContradiction)
    for size in range(1, len(found.relations)):
        for fewer in combinations([*relations, *extra], size):
            assert isinstance(assemble_parts(fewer, "b"), Assembled)
