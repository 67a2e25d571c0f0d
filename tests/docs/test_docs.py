"""What README and docs say of the command line is so: verbs, options, exit codes, command lines
and what they print.
"""

import contextlib
import math
import re
import shutil
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import typer
from golden_texts import compare_with_golden

from cellwright.engine.authoring.starter import create_domain
from cellwright.engine.faces.cli import app
from cellwright.engine.faces.cli.process import exit_codes
from cellwright.engine.formats.interop.range_files import write_ranges
from cellwright.engine.formats.interop.results import ResultForm
from cellwright.engine.formats.interop.results import write_results as written_results
from cellwright.engine.stages.vision.sensor_images import of_depths
from cellwright.kb.model.cell_model import Ranging
from cellwright.kb.model.measured_results import Measured, Results
from tests.docs.pages import DECISIONS, PATHS, Run, assert_shown, parts, run

TOP = Path(__file__).parents[2]
PAGES = {file.name: file.read_text("utf-8") for file in PATHS} | {
    f"decisions/{file.name}": file.read_text("utf-8") for file in DECISIONS
}
COMMANDS = PAGES["command-line.md"]
FIRST_PAGES = ("README.md", "first-steps.md", "command-line.md")
FIRST = "\n".join(PAGES[name] for name in FIRST_PAGES)
STORIES = ("tutorial.md",)  # gone through from top to bottom, by a test of their own
CELLWRIGHT = typer.main.get_command(app)
VERBS = CELLWRIGHT.commands  # type: ignore[attr-defined]

DOMAIN = """(define (domain shelf) (:predicates (at ?x) (on ?x))
  (:action lift :parameters (?x) :precondition (at ?x) :effect (and (on ?x) (not (at ?x)))))
"""
PROBLEM = (
    "(define (problem one) (:domain shelf) (:objects box) (:init (at box)) (:goal (on box)))\n"
)
POINTS = "name,x,y,z,nx,ny,nz\na,0,0,0,0,0,1\nb,9,0,0,0,0,1\n"
PART = """<QIFDocument><Features><FeatureDefinitions><PlaneFeatureDefinition id="1"/></FeatureDefinitions><FeatureNominals>
<PlaneFeatureNominal id="2"><FeatureDefinitionId>1</FeatureDefinitionId><Normal>0 0 1</Normal>
<PolyLine count="4">0 0 0 90 0 0 90 90 0 0 90 0</PolyLine></PlaneFeatureNominal></FeatureNominals></Features></QIFDocument>
"""
SQUARE = """NAME: square
TYPE: TSP
DIMENSION: 4
EDGE_WEIGHT_TYPE: EUC_2D
NODE_COORD_SECTION
1 0 0
2 9 0
3 9 9
4 0 9
EOF
"""
PLACEHOLDERS = {
    "TARGET": "mine/problems/two_items.yaml",
    "FOLDER": "mine",
    "DEVICE": "furnace",
    "FILE": "plan.json",
    "KIND": "domain",
    "STEP": "1",
    "DOMAIN": "shelf.pddl",
    "PROBLEM": "box.pddl",
    "INSTANCE": "square.tsp",
    "TABLE": "points.csv",
    "PART": "part.qif",
    "SET": "set.json",
    "POINTS": "bore.csv",
    "LOWER": "lower.csv",
    "UPPER": "upper.csv",
    "JOB": "block.yaml",
    "RESULTS": "results.csv",
    "IMAGE": "image.npz",
    "SOURCE": "STORE",
    "URL": "copy.db",
}
ANSWERS = {0, exit_codes.INFEASIBLE}
# Others of the same verbs run quickly.
LONG = (
    " prepare ",
    " --folded",
    " --motion",
    " assemble ",
    " calibrate ",
    " watch ",
    "handey/turning",
    "run themse/sentence",
)


def written(pages: Iterable[str]) -> list[str]:
    """Every command line of pages: indented, or between backquotes; a quoted text may go on in
    the next line.
    """
    found: dict[str, None] = {}
    for page in pages:
        indented = re.findall(r'^    (cellwright (?:[^"\n]|"[^"]*")*)$', page, re.MULTILINE)
        inline = re.findall(
            r"(?<!`)`(cellwright [^`]*)`", re.sub(r"^```.*?^```", "", page, flags=re.M | re.S)
        )
        found |= dict.fromkeys(" ".join(each.split()) for each in [*indented, *inline])
    serving = ("cellwright monitor", "cellwright lsp")  # they serve until they are ended
    # it writes into the home of whoever runs the tests
    installing = ("cellwright --install-completion",)
    return [line for line in found if not line.startswith(serving + installing)]


OWN = {name: page for name, page in PAGES.items() if name not in STORIES}
PICTURES = [line for line in written(OWN.values()) if " > pictures/" in line]


@pytest.fixture(scope="module")
def furnished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with one of each kind of file that a placeholder stands for."""
    folder = tmp_path_factory.mktemp("desks") / "desk"
    create_domain(folder / "mine")
    (folder / "shelf.pddl").write_text(DOMAIN)
    (folder / "box.pddl").write_text(PROBLEM)
    (folder / "plan.ipc").write_text("(lift box)\n")
    (folder / "square.tsp").write_text(SQUARE)
    (folder / "points.csv").write_text(POINTS)
    (folder / "part.qif").write_text(PART)
    (folder / "set.json").write_text('{"problems": [{"from": "home", "to": "meas(m2)"}]}')
    (folder / "truth.json").write_text('{"shift_mm": [1, 0, 2], "values": {"m1": 12}}')
    (folder / "acts.json").write_text('[{"joints": [0, -90, 90, -90, -90, 0], "jaws": "stay"}]')
    measure(folder)
    with contextlib.chdir(folder):
        run("cellwright macros list --store STORE")
        run("cellwright import qif part.qif --output inspection.yaml")
        run(f"cellwright export pddl {PLACEHOLDERS['TARGET']} --output exported")
        planned = run(
            "cellwright plan --pddl exported/domain.pddl exported/problem.pddl --format ipc"
        )
        Path("exported.ipc").write_text(planned.stdout)
        Path("plan.json").write_text(
            run(f"cellwright plan {PLACEHOLDERS['TARGET']} --format json").stdout
        )
    return folder


def measure(folder: Path) -> None:
    """Clouds of points of a bore and of two planes, and a block that was measured on three
    sides and lies where it should.
    """
    turns = [(0.02 * math.cos(n), 0.02 * math.sin(n), 0.0005 * n) for n in range(60)]
    flat = [(0.001 * (n % 8), 0.001 * (n // 8)) for n in range(64)]
    clouds = {
        "bore": turns,
        "lower": [(*p, 0.0) for p in flat],
        "upper": [(*p, 0.004) for p in flat],
    }
    for name, points in clouds.items():
        rows = ["x,y,z", *(f"{x:.6f},{y:.6f},{z:.6f}" for x, y, z in points)]
        (folder / f"{name}.csv").write_text("\n".join(rows))
    block = ["name,x,y,z,nx,ny,nz"]
    for n in range(12):
        place = (97 * n % 50, 31 * n % 50, 71 * n % 50)
        block.append(
            f"m{n},{place[0]},{place[1]},{place[2]},{n % 3 == 0:d},{n % 3 == 1:d},{n % 3 == 2:d}"
        )
    (folder / "block.csv").write_text("\n".join(block))
    measured = Results(
        "block", "", tuple(Measured(f"m{n}", "profile", 0.0, "um") for n in range(12))
    )
    tool = Ranging("laser", 240, 240, 0.6, 0.3, 5e-5, 0.5, 0.0024)
    write_ranges(folder / "image.npz", of_depths(np.full((240, 240), 0.5), tool))
    (folder / "results.csv").write_text(written_results(measured, ResultForm.CSV))
    with contextlib.chdir(folder):
        run("cellwright import csv block.csv --output block.yaml")


@pytest.fixture
def desk(furnished: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of that folder, in which the test runs, as from a shell that everybody has."""
    monkeypatch.setattr("shellingham.detect_shell", lambda: ("bash", "/bin/bash"))
    monkeypatch.chdir(shutil.copytree(furnished, tmp_path / "desk"))
    return tmp_path / "desk"


def _plan_for(line: str) -> str:
    return "plan.ipc" if "--pddl" in line else "exported.ipc" if "--export" in line else "plan.json"


def filled(line: str) -> str:
    """The line with files of the desk in place of words in capitals."""
    words = {**PLACEHOLDERS, "PLAN": _plan_for(line)}
    if line.startswith("cellwright init "):
        words["FOLDER"] = "new"
    return " ".join(words.get(word, word) for word in line.split(" "))


def timed(line: str) -> object:
    """A command line to run.

    Quick are those of the first pages that do little: no long plan, no assembly, no arm in every
    step.
    """
    slow = line not in QUICK or any(part in line for part in LONG)
    return pytest.param(line, marks=pytest.mark.slow) if slow else line


QUICK = set(written([FIRST]))
EXAMPLES = [
    (path.name, part)
    for path in PATHS
    if path.name not in STORIES
    for part in parts(path.read_text("utf-8"))
    if isinstance(part, Run) and part.shown is not None
]
SHOWN = {part.line for _, part in EXAMPLES}  # these are run where what they print is read, too


@pytest.mark.parametrize(
    "line", [timed(each) for each in written(OWN.values()) if each not in {*SHOWN, *PICTURES}]
)
@pytest.mark.usefixtures("desk")
def test_a_command_line_runs(line: str) -> None:
    result = run(filled(line))
    # about a run that goes on, or has gone on, somewhere else
    if " RUN" in line or " resume " in line:
        assert (result.exit_code, "K421" in result.output) == (exit_codes.BAD_INPUT, True), (
            result.output
        )
    else:
        assert result.exit_code in ANSWERS, result.output


def test_there_are_command_lines() -> None:
    assert len(QUICK) >= 15


def test_every_verb_is_in_the_table_of_commands_and_no_other() -> None:
    table = re.findall(r"^\| `cellwright (\w+)", COMMANDS, re.MULTILINE)
    assert set(table) == set(VERBS)


def with_own(command: Any) -> Iterator[Any]:
    """A command, and all that it has below it."""
    yield command
    for each in getattr(command, "commands", {}).values():
        yield from with_own(each)


def test_every_option_that_is_named_exists() -> None:
    commands = [CELLWRIGHT, *(each for verb in VERBS.values() for each in with_own(verb))]
    options = {name for each in commands for parameter in each.params for name in parameter.opts}
    others = {"--help", "--update-golden"}  # of every command; of the tests
    for name, page in PAGES.items():
        prose = re.sub(r"^```.*?^```|`(?:python )?benchmarks/[^`]*`", "", page, flags=re.M | re.S)
        assert set(re.findall(r"(?<![\w-])--[a-z][a-z-]+", prose)) <= options | others, name


def test_every_exit_code_is_in_the_table_and_no_other() -> None:
    known = {0} | {value for value in vars(exit_codes).values() if isinstance(value, int)}
    table = {int(code) for code in re.findall(r"^\| (\d+) \|", COMMANDS, re.MULTILINE)}
    assert table == known


def of_a_kind(name: str, part: Run) -> object:
    """An example; a long search for a reason is slow, and so are the other pages."""
    slow = " explain " in part.line or name not in FIRST_PAGES
    return pytest.param(
        name, part, marks=[pytest.mark.slow] if slow else [], id=f"{name}: {part.line}"
    )


@pytest.mark.parametrize(("name", "part"), [of_a_kind(*each) for each in EXAMPLES])
@pytest.mark.usefixtures("desk")
def test_what_a_page_shows_is_what_is_printed(
    name: str, part: Run, request: pytest.FixtureRequest
) -> None:
    path = next(each for each in PATHS if each.name == name)
    assert_shown(path, {part: run(filled(part.line))}, request.config.getoption("--update-golden"))


def test_the_first_pages_show_a_plan_and_a_reason() -> None:
    assert len(EXAMPLES) >= 2


@pytest.mark.parametrize("line", [pytest.param(line, marks=pytest.mark.slow) for line in PICTURES])
@pytest.mark.usefixtures("desk")
def test_a_picture_is_what_its_command_draws(line: str, request: pytest.FixtureRequest) -> None:
    command, _, file = line.partition(" > ")
    text = run(filled(command)).stdout
    compare_with_golden(TOP / "docs" / file, text, request.config.getoption("--update-golden"))


def test_every_picture_is_shown_where_its_command_stands() -> None:
    pages = {name: page for name, page in PAGES.items() if name not in STORIES}
    shown = {
        file
        for page in pages.values()
        for file in re.findall(r"!\[[^\]]*\]\((pictures/[^)]+)\)", page)
    }
    assert shown == {line.partition(" > ")[2] for line in PICTURES}
    assert {f"pictures/{file.name}" for file in (TOP / "docs" / "pictures").iterdir()} == shown


@pytest.mark.parametrize("name", PAGES)
def test_links_lead_somewhere(name: str) -> None:
    folder = TOP if name == "README.md" else (TOP / "docs" / name).parent
    targets = re.findall(r"\]\(([^)#]+)[^)]*\)", PAGES[name])
    assert [each for each in targets if ":" not in each and not (folder / each).exists()] == []
