"""TSPLIB files: every metric against its formula, every layout against the matrix it was
written from.
"""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cellwright.engine.formats.interop.visit_files import (
    MATRIX_SHAPES,
    METRIC_FUNCTIONS,
    read_tsplib,
)
from cellwright.engine.model.tour_problem import Metric
from cellwright.kb.diagnostics import InvalidInput


def written(folder: Path, **entries: str) -> Path:
    file = folder / "one.tsp"
    head = {key: value for key, value in entries.items() if not key.endswith("SECTION")}
    body = {key: value for key, value in entries.items() if key.endswith("SECTION")}
    lines = [f"{key} : {value}" for key, value in head.items()]
    file.write_text(
        "\n".join([*lines, *(f"{key}\n{value}" for key, value in body.items()), "EOF"]) + "\n"
    )
    return file


@pytest.mark.parametrize(
    ("metric", "expected"),
    [("EUC_2D", 3), ("CEIL_2D", 4), ("MAN_2D", 4), ("MAX_2D", 3), ("ATT", 2)],
)
def test_each_metric_rounds_as_the_library_prescribes(
    tmp_path: Path, metric: str, expected: int
) -> None:
    file = written(
        tmp_path,
        NAME="two",
        TYPE="TSP",
        DIMENSION="2",
        EDGE_WEIGHT_TYPE=metric,
        NODE_COORD_SECTION="1 0 0\n2 1 3.1",
    )
    assert read_tsplib(file).travel.tolist() == [[0, expected], [expected, 0]]


def test_geographical_distances_are_kilometres_on_the_sphere(tmp_path: Path) -> None:
    file = written(
        tmp_path,
        NAME="quarter",
        TYPE="TSP",
        DIMENSION="2",
        EDGE_WEIGHT_TYPE="GEO",
        NODE_COORD_SECTION="1 0.0 0.0\n2 90.0 0.0",
    )
    assert abs(int(read_tsplib(file).travel[0, 1]) - 6378.388 * np.pi / 2) < 2


@given(st.sampled_from(sorted(MATRIX_SHAPES)), st.integers(2, 6), st.integers(0, 999))
def test_every_layout_gives_back_the_matrix_it_was_written_from(
    shape: str, n: int, seed: int
) -> None:
    import tempfile

    travel = np.random.default_rng(seed).integers(0, 99, (n, n))
    travel = travel if shape == "FULL_MATRIX" else travel + travel.T
    np.fill_diagonal(travel, 0)
    with tempfile.TemporaryDirectory() as folder:
        file = written(
            Path(folder),
            NAME="m",
            TYPE="ATSP" if shape == "FULL_MATRIX" else "TSP",
            DIMENSION=str(n),
            EDGE_WEIGHT_TYPE="EXPLICIT",
            EDGE_WEIGHT_FORMAT=shape,
            EDGE_WEIGHT_SECTION=" ".join(str(travel[cell]) for cell in MATRIX_SHAPES[shape](n)),
        )
        assert (read_tsplib(file).travel == travel).all()


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"TYPE": "CVRP"}, "neither TSP nor ATSP"),
        ({"DIMENSION": "three"}, "DIMENSION"),
        ({"EDGE_WEIGHT_TYPE": "XRAY1"}, "XRAY1"),
        ({"NODE_COORD_SECTION": "1 0 0\n2 0 x\n3 1 1"}, "'x' is not a number"),
        ({"NODE_COORD_SECTION": "1 0 0\n2 0 nan\n3 1 1"}, "'nan' is not a number"),
        ({"NODE_COORD_SECTION": "1 0 0"}, "has 3 numbers, but 9 are needed"),
    ],
)
def test_what_is_wrong_is_said(tmp_path: Path, change: dict[str, str], said: str) -> None:
    entries = {
        "NAME": "n",
        "TYPE": "TSP",
        "DIMENSION": "3",
        "EDGE_WEIGHT_TYPE": "EUC_2D",
        "NODE_COORD_SECTION": "1 0 0\n2 0 1\n3 1 1",
    }
    with pytest.raises(InvalidInput) as caught:
        read_tsplib(written(tmp_path, **(entries | change)))
    assert said in str(caught.value)
    assert caught.value.diagnostics[0].code == "K803"


def test_all_metrics_are_symmetric_and_zero_on_the_diagonal() -> None:
    places = np.random.default_rng(1).uniform(-80, 80, (9, 2))
    for kind in METRIC_FUNCTIONS.values():
        found = Metric(kind, places).matrix()
        assert (found == found.T).all()
        assert not found.diagonal().any()
