"""New names: what is renamed means the same under its new name, and what cannot be renamed is
refused with a reason.
"""

import re
import shutil
from collections import defaultdict
from pathlib import Path

import pytest
from test_names_in_files import LABORATORY, index_of

from cellwright.kb.check import check_domain
from cellwright.kb.diagnostics import Diagnostic, InvalidInput
from cellwright.kb.editing.name_index import FileIndex, NameIndex
from cellwright.kb.editing.text_changes import NotRenamed, fixes_of, rename_occurrences
from cellwright.kb.loader import load, problem_files
from cellwright.kb.loader.fault_base import load_faults

RENAMED = [
    ("accessible(place)", "reachable", "predicate"),
    ("probe: item", "sample", "type"),
    ("slot(unit, int)", "recess", "function"),
    ("drawer, furnace, freezer]", "tray", "object"),
    ("open_drawer:", "pull_drawer", "operator"),
    ("Item, Place):", "Thing", "variable"),
]


def apply(index: NameIndex, changes: list[tuple[str, int, int, str]]) -> None:
    """Write changes into the files."""
    by_file = defaultdict(list)
    for path, start, end, text in changes:
        by_file[path].append((start, end, text))
    for path, edits in by_file.items():
        text = index.files[path].text
        for start, end, new in sorted(edits, reverse=True):
            text = text[:start] + new + text[end:]
        Path(path).write_text(text)


def everything(folder: Path) -> str:
    """A domain with its problems and faults, as text without places."""
    domain = folder / "domain.yaml"
    problems = [load(path).problem for path in problem_files(domain)]
    return "\n".join(
        [repr(load(domain).domain), *map(repr, problems), repr(load_faults(domain)[0])]
    )


@pytest.fixture
def cell(tmp_path: Path) -> Path:
    return Path(shutil.copytree(LABORATORY, tmp_path / "themse"))


@pytest.mark.parametrize(("where", "name", "space"), RENAMED)
def test_a_renamed_domain_loads_and_names_nothing_by_its_old_name(
    cell: Path, where: str, name: str, space: str
) -> None:
    before, index = everything(cell), index_of(cell)
    file = index.files[str(cell / "domain.yaml")]
    offset = file.text.index(where)
    symbol = index.symbol(file, offset)
    assert symbol is not None
    assert symbol[0].space == space
    old = symbol[0].name
    apply(index, list(rename_occurrences(index, file, offset, name)))
    after = everything(cell)
    assert after != before
    again = index_of(cell)
    assert not list(again.uses(symbol[0])) or space == "variable"
    back = again.files[file.path]
    place = next(each.start for _, each in back.named(name))
    apply(again, list(rename_occurrences(again, back, place, old)))
    assert {path.name: path.read_text() for path in cell.rglob("*.yaml")} == {
        path.name: path.read_text() for path in LABORATORY.rglob("*.yaml")
    }


@pytest.mark.parametrize(
    ("where", "name", "why"),
    [
        ("probe_1..4", "p", "range"),
        ("accessible(place)", "at", "declared already"),
        ("accessible(place)", "Accessible", "small letter"),
        ("accessible(place)", "probe", "declared already"),
        ("accessible(place)", "numbered", "rules use"),
        ("Item, Place):", "Place", "already"),
        ("Item, Place):", "thing", "capital"),
        ("units: {time", "x", "no name"),
        ("int): depot", "x", "built in"),
        ("open_drawer), reply", "not", "no name here"),
    ],
)
def test_what_cannot_be_renamed_is_refused(where: str, name: str, why: str) -> None:
    index = index_of(LABORATORY)
    file = next(file for path, file in index.files.items() if path.endswith("domain.yaml"))
    with pytest.raises(NotRenamed, match=why):
        list(rename_occurrences(index, file, file.text.index(where), name))


TIMED = """domain: lab
units: {time: s}
types: {probe: object, tool: object}
objects: {tool: [saw, basin]}
fluents: {clean(probe): {}}
events: {cut(probe): {}}
operators:
  wash(Probe): {adds: clean(Probe), resources: basin, duration: 5 s}
  slice(Probe): {preconditions: clean(Probe), adds: cut(Probe), resources: saw, duration: 9 s}
windows:
  - at most 10 min from clean(P) to start of step slice(P)
  - keep: "exactly 60 min, up to 63 from start of plan to end of wash(P), price 2"
    for: {P: [p1]}
calendars:
  - {of: saw, open: 0 s to 90 s}
  - {of: slice(_), closed: 5 s to 6 s}
"""


@pytest.mark.parametrize(
    ("where", "name"),
    [("clean(probe)", "pure"), ("wash(P),", "rinse"), ("slice(_)", "mill"), ("saw, op", "knife")],
)
def test_names_in_windows_and_calendars_are_renamed(tmp_path: Path, where: str, name: str) -> None:
    (tmp_path / "domain.yaml").write_text(TIMED)
    problem = "problem: p\ndomain: lab\nobjects: {probe: [p1]}\ngoals: [clean(p1)]\n"
    (tmp_path / "p.yaml").write_text(problem)
    index = index_of(tmp_path)
    offset = TIMED.index(where)
    old = re.match(r"\w+", where)
    assert old is not None
    path = str(tmp_path / "domain.yaml")
    apply(index, list(rename_occurrences(index, index.files[path], offset, name)))
    text = (tmp_path / "domain.yaml").read_text()
    assert re.search(rf"\b{old[0]}\b", text) is None
    assert len(re.findall(rf"\b{name}\b", text)) == len(re.findall(rf"\b{old[0]}\b", TIMED))


def findings(domain: Path) -> list[Diagnostic]:
    try:
        return list(load(domain).warnings)
    except InvalidInput as error:
        return list(error.diagnostics)


@pytest.mark.parametrize(
    ("right", "wrong", "title"),
    [
        ("accessible(Place)", "acessible(Place)", "write 'accessible'"),
        ("probe: item", "probe: itm", "write 'item'"),
        (
            "preconditions: at(Item, Place), free",
            "precondition: at(Item, Place), free",
            "write 'preconditions'",
        ),
        ("pick(Item, Place):", "pick(Item):", "add Place to the header of pick"),
        ("adds: at(Item, mars_gripper)", "adds: at(Item, mars_griper)", "write 'mars_gripper'"),
    ],
)
def test_a_fix_takes_its_finding_away(cell: Path, right: str, wrong: str, title: str) -> None:
    domain = cell / "domain.yaml"
    domain.write_text(domain.read_text().replace(right, wrong, 1))
    before, index = findings(domain), index_of(cell)
    file = index.files[str(domain)]
    offered = {fix.title: fix for each in before for fix in fixes_of(index, file, each)}
    apply(index, list(offered[title].changes))
    assert [each for each in findings(domain) if not each.warning] == []


def test_an_unknown_predicate_is_declared_as_it_is_used(cell: Path) -> None:
    domain = cell / "domain.yaml"
    domain.write_text(domain.read_text().replace("accessible(Place)", "polished(rim, Place)", 1))
    (finding,) = [each for each in findings(domain) if "polished" in each.message]
    index = index_of(cell)
    offered = list(fixes_of(index, index.files[str(domain)], finding))
    fluent = next(fix for fix in offered if "fluents" in fix.title)
    assert fluent.title == "declare polished(rest, object) under `fluents:`"
    apply(index, list(fluent.changes))
    assert not [each for each in findings(domain) if each.code == "K101"]


def test_a_finding_beyond_the_text_has_no_fix() -> None:
    from cellwright.kb.diagnostics import Source

    file = FileIndex.of("domain.yaml", "domain: d\n")
    finding = Diagnostic(
        Source("domain.yaml", 90, 3), "K101", "unknown type 'x'", "did you mean 'y'?"
    )
    assert list(fixes_of(NameIndex({"domain.yaml": file}), file, finding)) == []


def fixed(domain: Path, code: str) -> str:
    """The text of a domain after the first fix of the first finding with a code."""
    finding = next(each for each in findings(domain) if each.code == code)
    index = index_of(domain.parent)
    fix = next(fixes_of(index, index.files[str(domain)], finding))
    apply(index, list(fix.changes))
    return domain.read_text()


def test_a_missing_key_is_added(cell: Path) -> None:
    domain = cell / "domain.yaml"
    before = domain.read_text()
    domain.write_text(before.replace("domain: themse\n", ""))
    after = fixed(domain, "K005")
    assert "domain: \ninclude:" in after
    domain.write_text(after.replace("domain: \n", "domain: themse\n"))
    assert [each for each in findings(domain) if not each.warning] == []


def test_what_nothing_uses_is_removed(cell: Path) -> None:
    domain = cell / "domain.yaml"
    text = domain.read_text()
    domain.write_text(re.sub(r"(?m)^(statics:.*\n)", r"\1  polished(probe): {}\n", text))
    found = [each for each in check_domain(load(domain).domain) if "polished" in each.message]
    assert [each.code for each in found] == ["K309"]
    index = index_of(cell)
    (fix,) = [
        each
        for each in fixes_of(index, index.files[str(domain)], found[0])
        if "remove" in each.title
    ]
    assert fix.title == "remove 'polished'"
    apply(index, list(fix.changes))
    assert domain.read_text() == text
