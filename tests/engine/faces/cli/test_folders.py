"""Every verb answers alike wherever it runs: folders of the user's with the names of our
packages change nothing.
"""

import json
import os
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from cellwright.engine.authoring.starter import create_domain
from cellwright.engine.faces.cli import app
from cellwright.engine.faces.cli.verb_table import VERBS
from tests.places import TOP

OURS = ("cellwright", "domains", "engine", "kb")
SQUARE = (
    "NAME: square\nTYPE: TSP\nDIMENSION: 4\nEDGE_WEIGHT_TYPE: EUC_2D\n"
    "NODE_COORD_SECTION\n1 0 0\n2 9 0\n3 9 9\n4 0 9\nEOF\n"
)
JOBS = {
    "cell": "cell show handey --format svg",
    "check": "check mine",
    "devices": "devices show furnace",
    "diagnose": "diagnose mine --exception not_gripped --tree",
    "explain": "explain plan.json 1",
    "export": "export pddl bulkhead/one_point",
    "format": "format mine",
    "import": "import qif points.csv",
    "init": "init fresh",
    "macros": "macros list --store known.db",
    "measurement": "measurement list bulkhead/twelve_points",
    "motion": "motion plan bulkhead --from home --to meas(m2)",
    "plan": "plan bulkhead/one_point",
    "prepare": "prepare mine --store new.db --jobs 2",
    "revise": "revise plan.json --done 1",
    "schedule": "schedule bulkhead/one_point",
    "schema": "schema domain",
    "sequence": "sequence square.tsp",
    "states": "states themse --contacts",
    "store": "store check --store known.db",
    "test": "test mine",
    "validate": "validate plan.json",
}
"""One small job of every verb, on the files of a desk."""
REFUSED = {
    **{
        verb: f"{verb} nosuch"
        for verb in ("abort", "answer", "approve", "continue", "interrupt", "retry", "stop")
    },
    **{verb: f"{verb} nosuch 1" for verb in ("add", "back", "correct", "skip")},
    **{verb: f"{verb} nosuch --store runs.db" for verb in ("resume", "results")},
    "driver": "driver nosuch",
    "handey": "handey nosuch",
    "lsp": "lsp nosuch",
    "monitor": "monitor nosuch --store runs.db",
    "place": "place nosuch on nosuch",
    "run": "run nosuch",
}
"""Verbs of a run that goes on, and others with side effects, asked for what there is not."""


@pytest.fixture(scope="module")
def desk(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A folder with the files of all jobs; no run goes on anywhere."""
    folder = tmp_path_factory.mktemp("desks") / "desk"
    create_domain(folder / "mine")
    (folder / "square.tsp").write_text(SQUARE)
    (folder / "points.csv").write_text("name,x,y,z,nx,ny,nz\na,0,0,0,0,0,1\nb,9,0,0,0,0,1\n")
    plan = ("plan", "bulkhead/one_point", "--store", str(folder / "known.db"), "--format", "json")
    (folder / "plan.json").write_text(CliRunner().invoke(app, plan).stdout)
    with tempfile.TemporaryDirectory() as running, pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_RUNTIME_DIR", running)  # a short name: sockets have room for no other
        yield folder


@pytest.fixture(scope="module")
def crowded(desk: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same files beside packages that have the names of ours and fail when they are
    imported.
    """
    folder = Path(shutil.copytree(desk, tmp_path_factory.mktemp("desks") / "crowded"))
    for name in OURS:
        _shadow(folder, name)
    return folder


def _shadow(folder: Path, name: str) -> None:
    (folder / name).mkdir()
    (folder / name / "__init__.py").write_text(
        f"raise RuntimeError('this is the {name} of the user')\n"
    )


def run(folder: Path, *command: str, said: str = "") -> subprocess.CompletedProcess[str]:
    """A command in a folder, with this checkout on the path of Python."""
    environment = {**os.environ, "PYTHONPATH": str(TOP), "COLUMNS": "120"}
    how: dict[str, Any] = {"capture_output": True, "text": True, "check": False}
    return subprocess.run(command, cwd=folder, env=environment, input=said, **how)


def script(name: str) -> str:
    """An installed script."""
    found = shutil.which(name, path=sysconfig.get_path("scripts"))
    assert found is not None
    return found


def test_every_verb_has_a_job() -> None:
    assert {*JOBS, *REFUSED} == set(VERBS)


RUN_ALL = """import json, sys
from typer.testing import CliRunner
from cellwright.engine.faces.cli import app

if __name__ == "__main__":
    told = {}
    for verb, line in json.load(sys.stdin).items():
        result = CliRunner().invoke(app, line.split(), env={"COLUMNS": "120"})
        told[verb] = [result.exit_code, result.stdout, result.stderr]
    json.dump(told, sys.stdout)
"""


@pytest.fixture(scope="module")
def told(crowded: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[object]]:
    """What every verb answers in the crowded folder: in one process, started by a script that
    lies elsewhere, as ours does.
    """
    every = tmp_path_factory.mktemp("scripts") / "every.py"
    every.write_text(RUN_ALL)
    ran = run(crowded, sys.executable, str(every), said=json.dumps(JOBS | REFUSED))
    assert ran.returncode == 0, ran.stderr
    return dict(json.loads(ran.stdout))


@pytest.mark.parametrize("verb", JOBS | REFUSED)
def test_packages_of_the_user_with_our_names_change_no_answer(
    verb: str,
    told: dict[str, list[object]],
    desk: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(Path(shutil.copytree(desk, tmp_path / "alone")))
    alone = CliRunner().invoke(app, (JOBS | REFUSED)[verb].split(), env={"COLUMNS": "120"})
    assert told[verb] == [0 if verb in JOBS else 2, alone.stdout, alone.stderr]


@pytest.mark.parametrize("verb", ["plan", pytest.param("check", marks=pytest.mark.slow)])
def test_the_installed_script_answers_beside_packages_with_our_names(
    verb: str, crowded: Path
) -> None:
    assert run(crowded, script("cellwright"), *JOBS[verb].split()).returncode == 0


@pytest.mark.slow
def test_a_folder_of_domains_hides_no_bundled_one_even_where_python_looks_in_it_first(
    tmp_path: Path,
) -> None:
    _shadow(tmp_path, "domains")
    ran = run(
        tmp_path,
        sys.executable,
        "-m",
        "cellwright.engine.faces.cli",
        "export",
        "pddl",
        "bulkhead/one_point",
    )
    assert ran.returncode == 0, ran.stderr


@pytest.mark.slow
def test_golden_plans_run_with_pytest_beside_packages_with_our_names(crowded: Path) -> None:
    ran = run(crowded, script("pytest"), "mine")
    assert ran.returncode == 0, ran.stdout
    assert "1 passed" in ran.stdout
