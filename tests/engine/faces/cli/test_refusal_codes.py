"""Each kind of refusal has a code of its own, so that a program can tell them apart."""

import json

import pytest
from typer.testing import CliRunner

from cellwright.engine.faces.cli import app
from cellwright.engine.pipelines.planning import target_files
from cellwright.engine.plugins import geometry_backend
from cellwright.kb.diagnostics import InvalidInput
from tests.refusals import REFUSALS

LINES = [(code, line) for code, lines in REFUSALS.items() for line in lines]
SHOP = {"duration_matrix": [[1]], "machines_matrix": [[0]]}
INLINE = (
    "problem: inline\ndomain: bulkhead\nobjects:\n  measurement: [m1]\nstatics:\n  - needs(m1, "
    "profile)\n"
    "initial:\n  - at(t3_746, approach_point(meas(m1)))\n"
)
BARE = (
    "domain: bare\ntypes: {lamp: object}\nfluents:\n  lit(lamp): {}\noperators:\n  light(Lamp): "
    "{adds: lit(Lamp)}\n"
)
DARK = "problem: dark\ndomain: bare\nobjects: {lamp: [left]}\ngoals: [lit(left)]\n"


@pytest.fixture(scope="module")
def places(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """The files that the command lines name."""
    top = tmp_path_factory.mktemp("refusals")
    files = {
        "plan.json": CliRunner()
        .invoke(app, ["plan", "bulkhead/one_point", "--format", "json"])
        .stdout,
        "other.json": "[1, 2]",
        "shops.json": json.dumps({"a": SHOP, "b": SHOP}),
        "points.csv": "name,x,y,z,nx,ny,nz\nm1,0,0,0,0,0,1\n",
        "problem.yaml": INLINE,
        "bare/domain.yaml": BARE,
        "bare/problem.yaml": DARK,
    }
    for name, text in files.items():
        (top / name).parent.mkdir(exist_ok=True)
        (top / name).write_text(text)
    named = {"plan": "plan.json", "other": "other.json", "problem": "problem.yaml", "bare": "bare"}
    named |= {"folder": "", "store": "store.db", "closed": "nosuch"}
    return {key: str(top / name) for key, name in named.items()}


def code_of(line: str, places: dict[str, str]) -> str:
    words = [word.format(**places) for word in line.split()]
    result = CliRunner().invoke(app, [*words, "--format", "json"])
    assert result.exit_code in (2, 23), result.output
    return str(json.loads(result.stdout)["diagnostics"][0]["code"])


@pytest.mark.parametrize(("code", "line"), LINES)
def test_a_refusal_has_the_code_of_its_kind(code: str, line: str, places: dict[str, str]) -> None:
    assert code_of(line, places) == code


def test_a_plug_in_that_is_not_there() -> None:
    with pytest.raises(InvalidInput, match="K414"):
        geometry_backend("nosuch")


def test_too_little_memory(monkeypatch: pytest.MonkeyPatch, places: dict[str, str]) -> None:
    def fill(*_: object) -> None:
        raise MemoryError

    monkeypatch.setattr(target_files, "problem_of", fill)
    assert code_of("plan bulkhead/one_point", places) == "K419"
