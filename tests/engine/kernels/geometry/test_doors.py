"""Arrays that do not fit are refused before a kernel runs: compiled loops look at no bounds."""

from typing import Any

import numpy as np
import pytest

from cellwright.engine.kernels.geometry import checks, inverse, regions
from cellwright.engine.kernels.geometry.distance import Separations
from cellwright.engine.kernels.geometry.hierarchy import Hierarchy, build, inserted, removed
from cellwright.engine.kernels.geometry.layout import KIND, Pairs, Pieces
from cellwright.engine.kernels.geometry.mechanism import Mechanism, place_batch


def pieces(**changed: Any) -> Pieces:
    """Two points, the second on carrier 1."""
    arrays = {
        "vertices": np.zeros((2, 3)),
        "stretch": np.array([[0, 1], [1, 1]]),
        "radius": np.ones(2),
        "carrier": np.array([0, 1]),
        "bounds": np.zeros((2, KIND + 1)),
    }
    return Pieces(**(arrays | changed))


def pairs(**changed: Any) -> Pairs:
    """One pair."""
    arrays = {
        "pairs": np.array([[0, 1]]),
        "groups": np.array([[0, 1, 0, 1]]),
        "after": np.array([1]),
        "order": np.array([0]),
    }
    return Pairs(**(arrays | changed))


def hierarchy(**changed: Any) -> Hierarchy:
    """Two leaves and their parent."""
    arrays = {
        "boxes": np.zeros((3, 6)),
        "children": np.array([[-1, 0], [-1, 1], [0, 1]]),
        "root": 2,
    }
    return Hierarchy(**(arrays | changed))


@pytest.mark.parametrize(
    ("make", "changed"),
    [
        (pieces, {"vertices": np.zeros((2, 2))}),
        (pieces, {"vertices": np.zeros((2, 3), np.float32)}),
        (pieces, {"vertices": np.zeros((3, 2)).T}),
        (pieces, {"stretch": np.array([[0, 1], [1, 2]])}),
        (pieces, {"stretch": np.array([[0, 1], [-1, 1]])}),
        (pieces, {"stretch": np.array([[0, 1], [1, 0]])}),
        (pieces, {"carrier": np.array([0, -1])}),
        (pieces, {"bounds": np.zeros((2, 17))}),
        (pairs, {"groups": np.array([[0, 1, 0, 2]])}),
        (pairs, {"after": np.array([0])}),
        (pairs, {"pairs": np.array([[0, -1]])}),
        (pairs, {"order": np.zeros(2, np.int64)}),
        (hierarchy, {"boxes": np.zeros((3, 3))}),
        (hierarchy, {"boxes": np.zeros((2, 6))}),
        (hierarchy, {"children": np.array([[-1, 0], [-1, -1], [0, 1]])}),
        (hierarchy, {"children": np.array([[-1, 0], [-1, 1], [0, 2]])}),
        (hierarchy, {"root": 3}),
        (hierarchy, {"root": -2}),
    ],
)
def test_arrays_that_do_not_fit_together_are_refused(make: Any, changed: dict[str, Any]) -> None:
    make()
    with pytest.raises(ValueError, match=r"must (be|have|come)"):
        make(**changed)


def test_poses_must_be_those_of_all_carriers_and_results_have_a_row_for_each() -> None:
    poses, found = np.zeros((3, 2, 3, 4)), np.empty(3, np.int64)
    checks.first_contacts(poses, pieces(), pairs(), found)
    for bad in (poses[:, :1].copy(), poses[:, :, :2].copy()):
        with pytest.raises(ValueError, match="carrier poses must be"):
            checks.first_contacts(bad, pieces(), pairs(), found)
    with pytest.raises(ValueError, match="3 carrier poses have as many results"):
        checks.first_contacts(poses, pieces(), pairs(), found[:2])
    with pytest.raises(ValueError, match="pairs of 3 pieces"):
        checks.first_contacts(poses, pieces(), pairs(pairs=np.array([[0, 2]])), found)


def test_joints_need_a_value_each_and_hang_on_carriers_before_their_own() -> None:
    arrays = np.zeros((2, 4, 4)), np.zeros((2, 3)), np.zeros(2, bool)
    joints = Mechanism(np.array([0, 1]), *arrays)
    place_batch(joints, np.zeros((5, 2)), np.empty((5, 3, 3, 4)))
    with pytest.raises(ValueError, match="2 joints need"):
        place_batch(joints, np.zeros((5, 3)), np.empty((5, 3, 3, 4)))
    with pytest.raises(ValueError, match="hangs on a carrier that does not come before it"):
        Mechanism(np.array([1, 1]), *arrays)


def test_separations_are_asked_of_rows_that_are_there() -> None:
    separations = Separations(np.zeros((4, 3)), 2)
    assert separations.separation(0, 2, 0.5, 2, 2, 0.5) == -1.0
    for rows in ((0, 2, 3, 2), (-1, 2, 2, 2), (0, 3, 3, 1), (0, 0, 2, 2)):
        a, na, b, nb = rows
        with pytest.raises(ValueError, match="there are 4 rows"):
            separations.separation(a, na, 0.0, b, nb, 0.0)


def test_branches_have_eight_rows_of_six() -> None:
    axes, E = np.zeros((6, 3)), np.zeros((2, 4, 4))
    inverse.Batch(axes, axes, (0.0, 0.0, 0.0), E, np.zeros((2, 8, 6)), np.zeros((2, 8)))
    with pytest.raises(ValueError, match="8, 6"):
        inverse.Batch(axes, axes, (0.0, 0.0, 0.0), E, np.zeros((2, 7, 6)), np.zeros((2, 8)))


def test_standing_pieces_are_asked_for_by_arrays_that_fit() -> None:
    asking, standing = pieces(), pieces(carrier=np.zeros(2, np.int64))
    poses, skip, out = np.zeros((3, 2, 3, 4)), np.zeros((2, 2), bool), np.zeros(3, bool)
    likely = np.full((1, 2), -1)
    pairs_of = np.zeros((0, 2), np.int64)
    regions.first_hits(poses, asking, standing, hierarchy(), pairs_of, skip, likely, out)
    for bad, why in (
        (
            (poses[:, :1].copy(), asking, standing, hierarchy(), pairs_of, skip, likely, out),
            "carrier poses must",
        ),
        ((poses, asking, asking, hierarchy(), pairs_of, skip, likely, out), "but 2 stand"),
        ((poses, asking, standing, hierarchy(), pairs_of, skip[:1], likely, out), "may touch"),
        (
            (poses, asking, standing, hierarchy(), pairs_of, skip, likely, out[:2]),
            "as many results",
        ),
        (
            (poses, asking, standing, hierarchy(), np.array([[0, 2]]), skip, likely, out),
            "pairs must be",
        ),
        (
            (poses, asking, standing, hierarchy(), pairs_of, skip, np.array([[0, 4]]), out),
            "likely to touch",
        ),
    ):
        with pytest.raises(ValueError, match=why):
            regions.first_hits(*bad)
    beyond = hierarchy(children=np.array([[-1, 0], [-1, 2], [0, 1]]))
    with pytest.raises(ValueError, match="a hierarchy over 3 pieces"):
        regions.near_pieces(standing, standing, beyond, 0.0, np.empty((4, 2), np.int64))
    with pytest.raises(ValueError, match="0 or more"):
        regions.near_pieces(
            standing, standing, hierarchy(), float("nan"), np.empty((4, 2), np.int64)
        )


def test_a_hierarchy_is_changed_by_boxes_that_fit() -> None:
    with pytest.raises(ValueError, match="shape"):
        inserted(hierarchy(), np.zeros(3), 2)
    with pytest.raises(ValueError, match="0 or more"):
        inserted(hierarchy(), np.zeros(6), -1)
    with pytest.raises(KeyError):
        removed(hierarchy(), np.zeros(6), 2)
    with pytest.raises(ValueError, match="numbers"):
        build(np.zeros((2, 6)), np.zeros(3, np.int64), np.zeros((3, 6)), np.zeros((3, 2), np.int64))
