"""`check` of one file that is neither a domain nor a problem: each mistake at its own line."""

import shutil
from pathlib import Path

import pytest

from cellwright.engine.authoring.domain_check import check_domain_files
from cellwright.kb.loader.arm_file import bundled_arms
from cellwright.kb.targets import BUNDLED_DOMAINS


def changed_file(folder: Path, domain: str, file: str, old: str, new: str) -> tuple[Path, int]:
    """A copy of a bundled domain with one place of a file changed; the file and the line."""
    leave_out = shutil.ignore_patterns("problems", "golden", "large")
    shutil.copytree(BUNDLED_DOMAINS / domain, folder / domain, ignore=leave_out)
    path = folder / domain / file
    text = path.read_text()
    assert text.count(old) == 1
    path.write_text(text.replace(old, new))
    return path, text[: text.index(old)].count("\n") + 1


MISTAKES = [
    ("bulkhead", "cell.yaml", "{at: meas(Id), ends: inside}", "{at: mess(Id)}", "K101", "mess"),
    ("bulkhead", "cell.yaml", "box: [0.84, 0.9, 0.12]", "box: [0.84, wide]", "K005", ""),
    ("bulkhead", "cell.yaml", "  rail:\n", "  rail\n", "K002", ""),
    ("bulkhead", "cell.yaml", "units: {length: m,", "unit: {length: m,", "K005", "unit"),
    ("themse", "cell.yaml", "slot(drawer, 1):", "slot(drawer, first):", "K103", "first"),
    ("themse", "cell.yaml", "slot(drawer, 1):", "slot(drawer):", "K102", "slot"),
    ("dual", "cell.yaml", "follows: left_finger}", "follows: left_hand}", "K101", "left_hand"),
    ("handey", "cell.yaml", "heel: [a, b, h, g]", "heel: [a, b, h, l]", "K702", "heel"),
    ("handey", "scene.yaml", "clutter: [brick, slab]", "clutter: [brik, slab]", "K101", "brik"),
    ("bulkhead", "faults.yaml", "faults: bulkhead", "fault: bulkhead", "K005", "fault"),
]


@pytest.mark.parametrize(("domain", "file", "old", "new", "code", "said"), MISTAKES)
def test_a_mistake_is_told_at_its_line(
    tmp_path: Path, domain: str, file: str, old: str, new: str, code: str, said: str
) -> None:
    path, line = changed_file(tmp_path, domain, file, old, new)
    told = check_domain_files(str(path), reach=False).diagnostics
    here = [d for d in told if d.where.line == line and Path(d.where.path) == path]
    assert any(d.code == code and said in d.message for d in here), [*map(str, told)]


def test_the_files_of_the_bundled_cells_have_no_errors() -> None:
    handey = BUNDLED_DOMAINS / "handey"
    alone = [handey / "scenes" / "five_cell.yaml", handey / "scene.yaml", bundled_arms()["ur5"]]
    for path in alone:
        report = check_domain_files(str(path), reach=False)
        assert (report.checked, report.diagnostics) == ((str(path),), ())
    report = check_domain_files(str(BUNDLED_DOMAINS / "gauging" / "cell.yaml"), reach=False)
    assert len(report.checked) > 3
    assert report.diagnostics == ()


@pytest.mark.parametrize("file", ["device.yaml", "cell.yaml"])
def test_a_file_of_a_device_is_checked_with_a_domain(file: str) -> None:
    report = check_domain_files(str(BUNDLED_DOMAINS / "devices" / "furnace" / file))
    assert [finding.code for finding in report.diagnostics] == ["K404"]
