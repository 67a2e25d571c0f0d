"""What cannot be so in a real cell is told where it is written, and a sound cell is told
nothing.
"""

from pathlib import Path

import pytest

from cellwright.engine.authoring.domain_check import check_domain_files

DOMAIN = """domain: lab
units: {time: s}
types: {probe: object, place: object}
objects:
  place: [hand, slot_1, slot_2, furnace]
statics:
  label(probe, text): {}
  longest_stay(place, time): {}
  due(probe, time): {}
fluents:
  at(probe, place): {}
  heated(probe): {}
  cold(probe): {}
events:
  seen(probe): {}
operators:
  pick(Probe, Place):
    where: Place != hand
    preconditions: at(Probe, Place), not at(_, hand)
    adds: at(Probe, hand)
    resources: hand, Probe
    duration: 7 s
    command: {stream: "arm(pick(Probe, Place))", reply: done}
  put(Probe, Place):
    where: Place != hand
    preconditions: at(Probe, hand), not at(_, Place)
    adds: at(Probe, Place)
    resources: hand, Probe
    duration: 8 s
    command: {stream: "arm(put(Probe, Place))", reply: done}
  heat(Probe):
    preconditions: at(Probe, furnace), not cold(Probe)
    adds: heated(Probe)
    resources: furnace, Probe
    duration: 60 s
    command: {stream: "furnace(heat)", reply: done}
  look(Probe, Label):
    where: label(Probe, Label)
    preconditions: at(Probe, slot_2)
    adds: seen(Probe), cold(Probe)
    duration: 2 s
    command: {stream: "reader(scan)", reply: code(Label)}
deductive_operators:
  - when: at(X, P)
    denies: at(X, O), O != P
"""
PROBLEM = """problem: p
domain: lab
objects: {probe: [p1, p2]}
statics:
  - label(p1, "x")
  - longest_stay(furnace, 500), due(p1, 100)
initial:
  - at(p1, slot_1)
  - at(p2, slot_2)
goals:
  - heated(p1)
workflow:
  - for: {P: [p1]}
    stages: heated(P)
"""


def told(folder: Path, domain: str = DOMAIN, problem: str = PROBLEM) -> list[tuple[str, int]]:
    """The codes and lines that `check` tells."""
    (folder / "problems").mkdir()
    (folder / "domain.yaml").write_text(domain)
    (folder / "problems" / "p.yaml").write_text(problem)
    return [(each.code, each.where.line) for each in check_domain_files(str(folder)).diagnostics]


def line_of(text: str, said: str) -> int:
    return text[: text.index(said)].count("\n") + 1


def test_a_sound_cell_is_told_nothing(tmp_path: Path) -> None:
    assert told(tmp_path) == []


@pytest.mark.parametrize(
    ("old", "new", "code", "line"),
    [
        ("    duration: 60 s\n", "", "K317", "  heat(Probe):"),
        ("hand), not at(_, Place)", "hand), not  at(_, Place)", "", ""),
        (
            "adds: at(Probe, Place)\n    resources: hand, Probe",
            "adds: at(Probe, Place)\n    resources: Probe",
            "K305",
            "  put(Probe, Place):",
        ),
        ("look(Probe, Label):", "look(Probe):", "K318", "  look(Probe):"),
    ],
)
def test_what_is_wrong_with_a_step_is_told_at_the_step(
    tmp_path: Path, old: str, new: str, code: str, line: str
) -> None:
    assert old in DOMAIN
    domain = DOMAIN.replace(old, new)
    assert told(tmp_path, domain) == ([(code, line_of(domain, line))] if code else [])


@pytest.mark.parametrize(
    ("old", "new", "code", "line"),
    [
        ("at(p2, slot_2)", "at(p2, slot_1)", "K314", "at(p2, slot_1)"),
        ("furnace, 500", "furnace, -500", "K113", "longest_stay"),
        ("due(p1, 100)", "due(p1, 74)", "K319", "due(p1, 74)"),
        ("due(p1, 100)", "due(p1, 75)", "", ""),
        (
            "  - heated(p1)\n",
            '  - heated(p1)\n  - label(p1, "x")\n',
            "K108",
            '  - label(p1, "x")\nworkflow',
        ),
        ("stages: heated(P)", "stages: heated(P), seen(P)", "", ""),
    ],
)
def test_what_is_wrong_with_facts_and_goals_is_told_at_their_line(
    tmp_path: Path, old: str, new: str, code: str, line: str
) -> None:
    problem = PROBLEM.replace(old, new)
    assert problem != PROBLEM
    assert told(tmp_path, problem=problem) == ([(code, line_of(problem, line))] if code else [])


def test_a_goal_that_nothing_makes_true_is_told_at_its_line(tmp_path: Path) -> None:
    domain = DOMAIN.replace("seen(Probe), cold(Probe)", "seen(Probe)")
    problem = PROBLEM.replace("  - heated(p1)\n", "  - heated(p1)\n  - cold(p2)\n")
    assert ("K310", line_of(problem, "  - cold(p2)")) in told(tmp_path, domain, problem)


def test_a_place_is_shared_by_a_derived_predicate_too(tmp_path: Path) -> None:
    domain = DOMAIN.replace("not at(_, hand)", "free(hand)").replace(
        "not at(_, Place)", "free(Place)"
    )
    domain += "derived:\n  free(place): {}\ninclude: [rules.lp]\n"
    (tmp_path / "rules.lp").write_text("free(P) :- place(P), not at(_, P).\n")
    problem = PROBLEM.replace("at(p2, slot_2)", "at(p2, slot_1)")
    assert told(tmp_path, domain, problem) == [("K314", line_of(problem, "at(p2, slot_1)"))]


@pytest.mark.parametrize("line", [n for n, text in enumerate(DOMAIN.splitlines()) if ":" in text])
def test_a_colon_that_is_missing_is_told_in_its_line(tmp_path: Path, line: int) -> None:
    """Where YAML cannot be read any more.

    Some texts can still be read without a colon: as something else.
    """
    lines = DOMAIN.splitlines()
    lines[line] = lines[line].replace(":", "", 1)
    found = told(tmp_path, "\n".join(lines) + "\n")
    yaml = [where for code, where in found if code == "K002"]
    assert yaml in ([], [line + 1])


@pytest.mark.parametrize("line", range(4))
def test_a_full_stop_that_is_missing_is_told_in_its_line(tmp_path: Path, line: int) -> None:
    lines = ['hot("a. b").', "hot(1) :- hot(2), % not. here", "  hot(3).", "hot(4)."]
    lines[line] = lines[line].replace(").", ")") if line != 1 else lines[line]
    (tmp_path / "rules.lp").write_text("\n".join(lines) + "\n")
    found = told(tmp_path, DOMAIN + "include: [rules.lp]\n")
    assert [where for code, where in found if code == "K201"] == ([] if line == 1 else [line + 1])


def test_workflows_that_wait_for_one_another_are_told_where_the_circle_begins(
    tmp_path: Path,
) -> None:
    entries = "".join(
        f"  - name: {name}\n    after: [{after}]\n    stages: heated(p{number})\n"
        for number, (name, after) in enumerate([("a", "b"), ("b", "a")], 1)
    )
    problem = PROBLEM.split("workflow:")[0] + "workflow:\n" + entries
    (tmp_path / "problems").mkdir()
    (tmp_path / "domain.yaml").write_text(DOMAIN)
    (tmp_path / "problems" / "p.yaml").write_text(problem)
    found = check_domain_files(str(tmp_path)).diagnostics[0]
    assert found.where.line == line_of(problem, "after: [b]")
    assert found.message == "the workflow 'a' waits for itself: a after b after a"
