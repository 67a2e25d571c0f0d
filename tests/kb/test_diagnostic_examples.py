"""One broken file per diagnostic code, and more where a code has several messages: what is
printed is golden.
"""

from collections.abc import Callable
from pathlib import Path

import pytest

from cellwright.engine.authoring import domain_check
from cellwright.engine.formats.interop.inspection_files import inspection_remarks
from cellwright.engine.formats.interop.measurement_tables import read_table
from cellwright.engine.formats.interop.pddl import read_pddl_task
from cellwright.engine.formats.interop.pnml import read_pnml
from cellwright.engine.formats.interop.qif.feature_points import inspection_of
from cellwright.engine.formats.interop.shop_files import read_jobshop
from cellwright.engine.formats.interop.visit_files import read_tsplib, visits_of_target
from cellwright.engine.pipelines.planning import checked_plan
from cellwright.kb.asp import trial_grounding
from cellwright.kb.diagnostics import DIAGNOSTIC_CODES, Diagnostic, InvalidInput
from cellwright.kb.loader.cell import load_cell
from cellwright.kb.loader.plan import load_claimed
from tests.refusals import ENVIRONMENT, REFUSALS

DATA = Path(__file__).parents[1] / "data"
EXAMPLES = sorted(folder.name for folder in DATA.iterdir() if folder.is_dir())
PENDING: set[str] = set()  # codes that are being written
WITHOUT_A_PLACE = ("K001", "K002", "K402", "K404")  # what is wrong is the whole file
READERS: dict[str, Callable[[Path], object]] = {
    "*.tsp": read_tsplib,
    "*.csv": read_table,
    "*.txt": read_jobshop,
    "*.pnml": read_pnml,
}
WARNINGS: dict[str, Callable[[Path], tuple[Diagnostic, ...]]] = {
    "*.tsp": lambda file: visits_of_target(str(file)).warnings,
    "*.qif": lambda file: tuple(inspection_remarks(inspection_of(file), file)),
}


def warnings_of(folder: Path) -> tuple[Diagnostic, ...] | None:
    """What readers of other formats warn of; None if the folder has no such file."""
    for pattern, read in READERS.items():
        for file in folder.glob(pattern):
            read(file)
    found = [
        warnings(file) for pattern, warnings in WARNINGS.items() for file in folder.glob(pattern)
    ]
    return found[0] if found else None


def found_in(folder: Path) -> tuple[Diagnostic, ...]:
    """What validate, plan, plan --pddl, the readers of other formats or check report of this kind
    of example.
    """
    try:
        if (folder / "target.yaml").exists():
            checked_plan.problem_of(str(folder / "target.yaml"))
        if (folder / "plan.json").exists():
            problem, plan, claims = load_claimed(folder / "plan.json")
            return tuple(checked_plan.check_plan(problem, plan, str(folder / "plan.json"), claims))
        if (folder / "domain.pddl").exists():
            read_pddl_task(folder / "domain.pddl", folder / "problem.pddl")
        if (warned := warnings_of(folder)) is not None:
            return warned
        if (folder / "cell.yaml").exists():
            load_cell(folder / "cell.yaml")
        target = folder / "problem.yaml"
        return domain_check.check_domain_files(
            str(target if target.exists() else folder / "domain.yaml")
        ).diagnostics
    except InvalidInput as error:
        return error.diagnostics


@pytest.fixture(autouse=True)
def soon(monkeypatch: pytest.MonkeyPatch) -> None:
    """Grounding gives up soon."""
    monkeypatch.setattr(trial_grounding, "MAX_TRIAL_S", 1)


@pytest.mark.parametrize("name", EXAMPLES)
def test_the_message_of_an_example(
    name: str, golden: Callable[[str, str], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(DATA)
    found = found_in(Path(name))
    assert name[:4] in {each.code for each in found}
    golden(f"diagnostics/{name}.txt", "\n".join(map(str, found)) + "\n")


def test_every_code_has_an_example() -> None:
    shown = {name[:4] for name in EXAMPLES} | {*REFUSALS, *ENVIRONMENT}
    assert shown | PENDING == set(DIAGNOSTIC_CODES)
    assert not shown & PENDING


@pytest.mark.parametrize("name", [name for name in EXAMPLES if name < "K5"])
def test_a_message_says_where_what_and_what_to_try(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(DATA)
    for each in found_in(Path(name)):
        assert each.hint
        assert each.message
        known_place = each.where.line and each.where.text.strip()
        assert known_place or each.code in WITHOUT_A_PLACE, each


def test_all_that_is_wrong_is_said_in_one_run(tmp_path: Path) -> None:
    text = (DATA / "K101_unknown_type" / "domain.yaml").read_text()
    text = text.replace("bolt, nut", "bolt, nut, bolt").replace(
        "adds: at(Item, To)", "adds: at(Item, To"
    )
    (tmp_path / "domain.yaml").write_text(text)
    assert {each.code for each in found_in(tmp_path)} == {"K101", "K104", "K106"}
