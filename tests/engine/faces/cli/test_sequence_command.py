"""`cellwright sequence` on files."""

import json
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from cellwright.engine.faces.cli import app

RING = "\n".join(
    f"{i + 1} {round(1000 * np.cos(a))} {round(1000 * np.sin(a))}"
    for i, a in enumerate(np.linspace(0, 6, 12))
)


@pytest.fixture
def ring(tmp_path: Path) -> str:
    file = tmp_path / "ring.tsp"
    file.write_text(
        "NAME: ring\nTYPE: TSP\nDIMENSION: 12\nEDGE_WEIGHT_TYPE: "
        f"EUC_2D\nNODE_COORD_SECTION\n{RING}\nEOF\n"
    )
    return str(file)


def run(*arguments: str) -> tuple[int, str]:
    result = CliRunner().invoke(app, ["sequence", *arguments])
    return result.exit_code, result.stdout


def test_a_ring_is_toured_round(ring: str) -> None:
    code, out = run(ring, "--format", "json")
    answer = json.loads(out)
    assert code == 0
    assert answer["status"] == "optimal"
    order = [int(each) for each in answer["data"]["visits"]]
    assert {abs(a - b) for a, b in pairwise(order)} <= {1, 11}


def test_open_tours_begin_and_end_where_they_should(ring: str) -> None:
    _, out = run(ring, "--open", "--start", "4", "--end", "9", "--format", "json")
    visits = json.loads(out)["data"]["visits"]
    assert (visits[0], visits[-1], sorted(map(int, visits))) == ("4", "9", list(range(1, 13)))


def test_the_same_input_gives_the_same_bytes(ring: str) -> None:
    assert run(ring, "--format", "json") == run(ring, "--format", "json")


def test_a_tour_is_drawn_with_a_line_for_each_way(ring: str) -> None:
    assert run(ring, "--format", "svg")[1].count('class="way"') == 12
    assert run(ring, "--open", "--format", "svg")[1].count('class="way"') == 11


@pytest.mark.parametrize("wrong", [["--start", "77"], ["--method", "magic"]])
def test_unknown_names_are_bad_input(ring: str, wrong: list[str]) -> None:
    assert run(ring, *wrong)[0] == 2


def test_one_visit_cannot_be_both_ends_of_many(ring: str) -> None:
    assert run(ring, "--open", "--start", "1", "--end", "1")[0] == 10
