"""Exports seen by others: Fast Downward plans them, unified-planning's validator checks our plans
for them.

Fast Downward is looked for in this environment (the package `up-fast-downward`), in that of the
Python which CELLWRIGHT_PEERS names, and on the path.
"""

import functools
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from cellwright.engine.formats.interop.pddl.export import import_plan, pddl_text_of
from cellwright.engine.model.outcome import Found, Infeasible
from cellwright.engine.pipelines.planning import checked_plan
from cellwright.engine.stages.grounding import ground
from cellwright.kb.loader import find_target, problem_files
from tests.places import DOMAINS

SOLVED, PROVED_UNSOLVABLE = 0, (10, 11)  # exit codes of its driver
HERE = Path(__file__)
TESTED = sorted(
    file
    for file in (*DOMAINS.glob("*/problems/*.yaml"), *HERE.parent.glob("pantry/problems/*.yaml"))
)
BUNDLED = [file for name in ("bulkhead", "themse") for file in problem_files(find_target(name))]


def named(file: Path) -> str:
    return f"{file.parents[1].name}-{file.stem}"


@functools.cache
def fast_downward() -> tuple[str, ...]:
    """The command that starts its driver; nothing if there is none."""
    code = "import up_fast_downward as package; print(package.__path__[0])"
    for python in [sys.executable, *filter(None, [os.environ.get("CELLWRIGHT_PEERS")])]:
        found = subprocess.run([python, "-c", code], capture_output=True, text=True, check=False)
        if found.returncode == 0:
            return python, str(Path(found.stdout.strip()) / "downward" / "fast-downward.py")
    driver = shutil.which("fast-downward") or shutil.which("fast-downward.py")
    return (driver,) if driver else ()


@pytest.mark.parametrize("file", [*BUNDLED, *TESTED], ids=named)
def test_fast_downward_solves_exports_and_its_plans_are_accepted(
    file: Path, tmp_path: Path
) -> None:
    _solved(file, True, tmp_path)


@pytest.mark.parametrize("file", [BUNDLED[0], *TESTED], ids=named)
def test_fast_downward_solves_ground_exports_too(file: Path, tmp_path: Path) -> None:
    _solved(file, False, tmp_path)


def _solved(file: Path, lifted: bool, tmp_path: Path) -> None:
    if not fast_downward():
        pytest.skip("Fast Downward is not installed")
    problem = checked_plan.problem_of(str(file))
    text = pddl_text_of(problem, ground(problem), lifted)
    (tmp_path / "domain.pddl").write_text(text.domain)
    (tmp_path / "problem.pddl").write_text(text.problem)
    command = [*fast_downward(), "--alias", "lama-first", "domain.pddl", "problem.pddl"]
    ended = subprocess.run(command, cwd=tmp_path, capture_output=True, timeout=60, check=False)
    if isinstance(checked_plan.plan_problem(problem), Infeasible):
        assert ended.returncode in PROVED_UNSOLVABLE
        return
    assert ended.returncode == SOLVED, ended.stdout
    plan = import_plan(text, (tmp_path / "sas_plan").read_text())
    assert checked_plan.check_plan(problem, plan) == []


AXIOMS = ("maze", "pantry")  # the library does not read derived predicates
READABLE = [file for file in TESTED if file.parents[1].name not in AXIOMS]


@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # of the library about its own parser
@pytest.mark.parametrize("file", [*BUNDLED, *READABLE], ids=named)
def test_unified_planning_accepts_our_plans_for_exports(file: Path) -> None:
    up = pytest.importorskip("unified_planning")
    from unified_planning.engines import SequentialPlanValidator
    from unified_planning.io import PDDLReader

    assert up.__version__
    problem = checked_plan.problem_of(str(file))
    outcome = checked_plan.plan_problem(problem)
    text = pddl_text_of(problem, ground(problem))
    reader = PDDLReader()
    theirs = reader.parse_problem_string(text.domain, text.problem)
    if isinstance(outcome, Found):
        plan = reader.parse_plan_string(theirs, text.plans.written(outcome.plan))
        checked = SequentialPlanValidator().validate(theirs, plan)
        assert checked.status.name == "VALID", checked.reason
