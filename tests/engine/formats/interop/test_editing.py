"""Measurements in problem files: added and removed in every layout of their lists, and nothing
else changes.
"""

import shutil
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cellwright.engine.formats.interop.inspection_files import edit_measurements
from cellwright.engine.formats.interop.measurement_edits import (
    add_measurement_lines,
    find_list,
    remove_measurement_lines,
)
from cellwright.engine.model.part_measurements import MeasurementPoint, measurements_of
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.loader import load, load_domain, load_problem
from cellwright.kb.model.name_conventions import Conventions
from cellwright.kb.targets import BUNDLED_DOMAINS

WORDS = Conventions()
NEW = MeasurementPoint("m4", "m4", "profile", (0.001, 0.002, 0.003), (0.0, 0.0, 1.0))
FACTS = """\
statics:
  - needs(m1, thickness)  # the first
  - needs(m2, thickness), needs(m3, profile)
initial:
  - holding(t3_746, us_probe), hand_empty(t3_746)
"""
GOALS = """\
goals:
  - measured(_, _, meas(m2))
  - "measured(_, _, meas(m1)), measured(_, _, meas(m3))"
"""
HEAD = "problem: p\ndomain: bulkhead\n"
OBJECTS = [
    "objects:\n  measurement: [m1..3]\n",
    "objects:\n  measurement: [m1, m2, m3]  # three\n",
    "objects:\n  measurement: [m1..m3]\n  tool: [spare]\n",
    "objects:\n  measurement:\n    - m1\n    # the others\n    - m2..3\n",
    "objects:\n  measurement:\n  - m1..3\n",
    "objects: {measurement: [m1..3], tool: [spare]}\n",
    "objects:\n  tool: [spare]\n  measurement: [m1,\n    m2..3]\n",
]
SECTIONS = [
    FACTS + GOALS,
    GOALS + FACTS,
    FACTS.replace("statics:\n  - needs(m1, thickness)  # the first\n  - needs(m2, thickness), "
    "needs(m3, "
    "profile)\n",
                  'statics: ["needs(m1, thickness)", "needs(m2, thickness), needs(m3, '
                  'profile)"]\n') + GOALS,
    FACTS + 'goals: ["measured(_, _, meas(m2))", "measured(_, _, meas(m1)), measured(_, _, '
    'meas(m3))"]\n',
]  # fmt: skip


def change(folder: Path, text: str, how: str, what: MeasurementPoint | str) -> str:
    file = folder / "p.yaml"
    file.write_text(text, "utf-8")
    edit_measurements(file, how, [what])
    return file.read_text("utf-8")


def measurements(folder: Path) -> set[str]:
    problem = load(folder / "p.yaml").problem
    assert problem is not None
    return {name for name, type_ in problem.objects.items() if type_ == "measurement"}


@pytest.mark.parametrize("objects", OBJECTS)
@pytest.mark.parametrize("sections", SECTIONS)
@pytest.mark.parametrize(
    "name", ["m2", *(pytest.param(each, marks=pytest.mark.slow) for each in ("m1", "m3"))]
)
def test_a_measurement_is_removed_from_every_layout(
    tmp_path: Path, objects: str, sections: str, name: str
) -> None:
    before = HEAD + objects + sections
    after = change(tmp_path, before, "removed", name)
    problem = load(tmp_path / "p.yaml").problem
    assert problem is not None
    assert measurements(tmp_path) == {"m1", "m2", "m3"} - {name}
    assert len(problem.statics) == 2
    assert len(problem.initial) == 2
    assert str(problem.goal).count("measured") == 2
    assert name not in after.replace("# the first", "")


@pytest.mark.parametrize(
    "objects", [OBJECTS[0], *(pytest.param(each, marks=pytest.mark.slow) for each in OBJECTS[1:])]
)
@pytest.mark.parametrize("sections", SECTIONS)
def test_what_is_added_and_removed_again_leaves_the_same_problem(
    tmp_path: Path, objects: str, sections: str
) -> None:
    before = HEAD + objects + sections
    (tmp_path / "p.yaml").write_text(before, "utf-8")
    first = load(tmp_path / "p.yaml").problem
    assert first is not None
    change(tmp_path, before, "added", NEW)
    assert measurements(tmp_path) == {"m1", "m2", "m3", "m4"}
    edit_measurements(tmp_path / "p.yaml", "removed", ["m4"])
    last = load(tmp_path / "p.yaml").problem
    assert last is not None
    assert (last.objects, last.statics, last.initial, last.goal) == (
        first.objects,
        first.statics,
        first.initial,
        first.goal,
    )


@pytest.mark.parametrize(
    "file", sorted((BUNDLED_DOMAINS / "bulkhead" / "problems").glob("*.yaml")), ids=lambda f: f.stem
)
def test_bundled_problems_can_be_changed(tmp_path: Path, file: Path) -> None:
    shutil.copy(file, tmp_path / "p.yaml")
    before = load_problem(f"bulkhead/{file.stem}")
    gone = "m3" if "m3" in before.objects else "c2"
    edit_measurements(tmp_path / "p.yaml", "removed", [gone])
    edit_measurements(
        tmp_path / "p.yaml",
        "added",
        [MeasurementPoint("m90", "m90", "profile", (0, 0, 0), (0, 0, 1))],
    )
    assert measurements(tmp_path) == {*before.objects} - {gone} | {"m90"}


def test_several_are_changed_together_or_not_at_all(tmp_path: Path) -> None:
    file, before = tmp_path / "p.yaml", HEAD + OBJECTS[0] + SECTIONS[0]
    file.write_text(before, "utf-8")
    for measurements, wrong in ((["m1", "m2", "m1"], "m1"), (["m3", "m9"], "m9")):
        with pytest.raises(InvalidInput, match=wrong):
            edit_measurements(file, "removed", measurements)
    with pytest.raises(InvalidInput, match="already has"):
        edit_measurements(file, "added", [NEW, NEW])
    assert file.read_text("utf-8") == before
    edit_measurements(file, "removed", ["m1", "m3"])
    problem = load(file).problem
    assert problem is not None
    assert measurements_of(problem) == ["m2"]


def test_without_lists_they_are_made(tmp_path: Path) -> None:
    change(tmp_path, HEAD + "goals: []\n", "added", NEW)
    assert measurements(tmp_path) == {"m4"}
    problem = load(tmp_path / "p.yaml").problem
    assert problem is not None
    assert len(problem.statics) == 3
    assert str(problem.goal) == "measured(_, _, meas(m4))"


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ("initial:\n  - at(t3_746, in_contact_point(meas(m1)))\n", "the initial fact at(t3_746"),
        (
            "goals:\n  - measured(_, _, meas(m1)) | measured(_, _, meas(m2))\n",
            "stands in a condition with others",
        ),
        ("workflow:\n  - stages: measured(_, _, meas(m1))\n", "line 7 also names 'm1'"),
    ],
)
def test_what_needs_the_measurement_keeps_it(tmp_path: Path, more: str, said: str) -> None:
    before = HEAD + "objects:\n  measurement: [m1..2]\nstatics:\n  - needs(m1, profile)\n" + more
    with pytest.raises(InvalidInput) as raised:
        change(tmp_path, before, "removed", "m1")
    (found,) = raised.value.diagnostics
    assert found.code == "K418"
    assert said in found.message
    assert (tmp_path / "p.yaml").read_text("utf-8") == before


@given(st.sets(st.integers(1, 30), min_size=1), st.data())
def test_ranges_without_a_name_are_all_the_others(numbers: set[int], data: st.DataObject) -> None:
    items: list[str] = []
    for number in sorted(numbers):
        last = items[-1] if items else ""
        if last.endswith(f"m{number - 1}") and data.draw(st.booleans()):
            items[-1] = (
                f"{last.split('..')[0]}..{number}"
                if ".." not in last
                else f"{last.rsplit('..', 1)[0]}..{number}"
            )
        else:
            items.append(f"m{number}")
    gone = f"m{data.draw(st.sampled_from(sorted(numbers)))}"
    text = ["objects:", f"  measurement: [{', '.join(items)}]"]
    found = find_list(
        remove_measurement_lines(text, gone, "p", WORDS), ("objects", "measurement"), "p"
    )
    assert found is not None
    names = {name for each in found.entries() for name in _names(each.text)}
    assert names == {f"m{number}" for number in numbers} - {gone}


def _names(item: str) -> list[str]:
    low, _, high = item.partition("..")
    first = int(low[1:])
    return [f"m{number}" for number in range(first, int(high.removeprefix("m") or first) + 1)]


def test_a_range_grows_when_its_next_name_is_added() -> None:
    lines = add_measurement_lines(
        ["objects:", "  measurement: [m1..3]", "goals: []"],
        NEW,
        "p",
        load_domain("bulkhead").conventions,
    )
    assert lines[1] == "  measurement: [m1..4]"
