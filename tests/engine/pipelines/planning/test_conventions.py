"""A domain that calls every convention otherwise gets the same answers, apart from the names."""

import re
import shutil
from collections.abc import Collection, Iterator
from pathlib import Path

import pytest
from typer.testing import CliRunner

from cellwright.engine.authoring import domain_check
from cellwright.engine.faces.cli import app
from cellwright.engine.faces.monitor.background_answers import sequence_picture
from cellwright.engine.pipelines.planning.timetable import wishes_of
from cellwright.engine.stages.validation.operator_semantics import Semantics
from cellwright.kb.loader import load_domain, load_problem
from cellwright.kb.model.name_conventions import CONVENTION_BY_NAME
from tests.places import BUNDLED

TIMES = [role for role, each in CONVENTION_BY_NAME.items() if each.is_about_time]
POINTS = """name,x,y,z,nx,ny,nz,kind,tolerance,bore
a,0,0,0,0,0,1,profile,0.5,
b,10,0,0,0,0,2,,,
c,20,0,0,0,0,1,thickness,0.5,
d,30,0,0,0,0,1,profile,0.001,
e,40,0,0,0,0,1,profile,,1
g,50,0,0,0,0,1,thickness,,
"""
TIMED = """
travel(A, B, 4) :- part_of(A, drawer), part_of(B, furnace).
travel(A, B, 4) :- part_of(A, furnace), part_of(B, drawer).
longest_stay(furnace, 906).
release(probe_2, 100).
due(probe_1, 1500).
priority(probe_1, 2).
"""


DEVICES = {"bulkhead": ("measuring", "tool_rack", "ultrasonic_tool", "laser_tool")}


def cell(folder: Path, bundled: str, statics: Collection[str], rules: str = "") -> Path:
    """A copy of a bundled domain that declares some more conventions."""
    shutil.copytree(BUNDLED / bundled, folder)
    for device in DEVICES.get(bundled, ()):  # their files are renamed, too
        head = (
            shutil.copytree(BUNDLED / "devices" / device, folder / "devices" / device)
            / "device.yaml"
        )
        kept = head.read_text("utf-8").replace("conventions:\n  position: $position\n", "")
        head.write_text(kept, "utf-8")  # the domain itself says what it calls them
    domain, facts = folder / "domain.yaml", folder / "rules.lp"
    declared = "".join(
        f"  {CONVENTION_BY_NAME[role].written().replace('place', 'object')}: {{}}\n"
        for role in statics
    )
    domain.write_text(
        domain.read_text("utf-8").replace("\nstatics:", f"\nstatics:\n{declared}", 1), "utf-8"
    )
    facts.write_text(facts.read_text("utf-8") + rules, "utf-8")
    return folder


def rename(folder: Path, roles: Collection[str]) -> None:
    """Another name for each convention, in every file of a domain."""
    # of the part `measures` of a command; ports of a device
    key = r"(?:(?<=nominal)|(?<=tolerance)|(?<=\nneeds)):"
    words = re.compile(
        rf"(?<!\w)(?<!ends: )({'|'.join(roles)})(?!\w)(?!{key})"
    )  # where a step of a cell ends
    for file in (each for each in folder.rglob("*") if each.suffix in (".yaml", ".lp")):
        file.write_text(words.sub(r"\1own", file.read_text("utf-8")), "utf-8")
    section = "".join(f"  {role}: {role}own\n" for role in roles)
    with (folder / "domain.yaml").open("a", encoding="utf-8") as file:
        file.write(f"conventions:\n{section}")


def as_before(text: str) -> str:
    """A text with the names from before."""
    return re.sub(rf"(?<!\w)({'|'.join(CONVENTION_BY_NAME)})own(?!\w)", r"\1", text)


@pytest.fixture
def desks(tmp_path: Path) -> list[Path]:
    """Two folders, each with a bulkhead cell and a table of points; in the second all
    conventions have other names.
    """
    found = [tmp_path / "usual", tmp_path / "renamed"]
    for desk in found:
        cell(desk / "bulkhead", "bulkhead", TIMES)
        (desk / "points.csv").write_text(POINTS)
    rename(found[1] / "bulkhead", CONVENTION_BY_NAME)
    return found


def run(line: str) -> str:
    result = CliRunner().invoke(app, line.split())
    assert result.exit_code in (0, 10), result.output
    return result.stdout


def answers(desk: Path, lines: Collection[str], monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """What some commands print there, and the problem that they have imported, if they have."""
    monkeypatch.chdir(desk)
    yield from (as_before(run(line)).replace(str(desk), "DESK") for line in lines)
    if (made := desk / "points.yaml").exists():
        yield as_before(made.read_text("utf-8")).replace(str(desk), "DESK")


TWELVE = "bulkhead/problems/twelve_points.yaml --format json"
GROUPS = {
    "partition": [f"measurement list {TWELVE}"],
    "plan": ["plan bulkhead/problems/both_tools.yaml --format json"],
    "tour": [f"sequence {TWELVE} --work 50"],
    "tours of the arm": [f"sequence {TWELVE} --cost joints --work 20"],
    "schedule": [
        "schedule bulkhead/problems/both_tools.yaml --format json",
        "schedule bulkhead/problems/two_contacts.yaml --format json",
    ],
    "import": [
        "import qif points.csv --domain bulkhead --format json",
        "measurement add points.yaml h --at 60 0 0 --tolerance 0.2 --bore 9 --format json",
        "measurement add points.yaml i --at 70 0 0 --kind thickness --format json",
        "measurement edit points.yaml h --at 65 0 0 --kind thickness --format json",
        "measurement remove points.yaml c --format json",
        "measurement list points.yaml --format json",
        "sequence points.yaml --work 50 --format json",
    ],
    "kept sequence": [
        f"sequence {TWELVE} --work 50 --store kept.db",
        f"sequence {TWELVE} --work 50 --store kept.db --done m1,m2",
        f"sequence {TWELVE} --work 50 --store kept.db --lost us_probe",
        f"sequence {TWELVE} --work 50 --store kept.db --restored us_probe --bad m3=dirty",
        f"sequence {TWELVE} --work 50 --store kept.db --lost t3_746",
        f"sequence {TWELVE} --work 50 --store kept.db --next",
    ],
}


@pytest.mark.parametrize("group", GROUPS)
def test_other_names_are_other_names_and_nothing_else(
    desks: list[Path], group: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    usual, renamed = (list(answers(desk, GROUPS[group], monkeypatch)) for desk in desks)
    assert usual == renamed
    assert len(usual) >= len(GROUPS[group])


def test_every_convention_is_renamed_and_nothing_is_wrong_with_that(desks: list[Path]) -> None:
    target = str(desks[1] / "bulkhead")
    assert load_domain(target).renamed == {role: f"{role}own" for role in CONVENTION_BY_NAME}
    assert domain_check.check_domain_files(target, reach=False).diagnostics == ()


@pytest.mark.slow
def test_times_of_other_names_make_the_same_schedule(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    usual, renamed = (
        cell(tmp_path / each, "themse", TIMES, TIMED) for each in ("usual", "renamed")
    )
    rename(renamed, TIMES)
    problems = [load_problem(str(folder / "problems" / "two.yaml")) for folder in (usual, renamed)]
    said = [wishes_of(Semantics(each).statics, each.domain.conventions) for each in problems]
    assert said[0] == said[1]
    assert said[0].travel
    assert all(getattr(said[0], role) for role in TIMES)
    line = ["schedule problems/two.yaml --format json"]
    first, second = (list(answers(folder, line, monkeypatch)) for folder in (usual, renamed))
    assert first == second


def test_the_monitor_draws_the_order_of_measurements(desks: list[Path]) -> None:
    pictures = []
    for desk, fact in zip(
        desks,
        ("measured(slra, t3_746, meas({}))", "measuredown(slra, t3_746, measown({}))"),
        strict=True,
    ):
        steps = [{"id": n, "adds": [fact.format(f"m{n}"), "free"]} for n in (1, 2, 3)]
        target = (str(desk / "bulkhead/problems/twelve_points.yaml"), "", "")
        pictures.append(sequence_picture(target, {"steps": steps, "order": [2, 1, 3]}))
    assert pictures[0] is not None
    assert "m3" in pictures[0]
    assert pictures[0] == pictures[1]
