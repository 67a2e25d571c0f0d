"""What a domain forgets, and what is wrong with initial states: told where it is so, and
nowhere else.
"""

import itertools
from pathlib import Path

import pytest

from cellwright.engine.authoring.domain_check import check_domain_files
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source, order_diagnostics
from cellwright.kb.loader import load

CELL = Path(__file__).parents[2] / "data" / "K314_crowded"
GIVEN_BACK = "  - when: not at(Item, Place)\n    implies: free(Place)\n"
RULES = "fits(I, P) :- item(I), place(P).\nhome(bolt, table).\nhome(nut, bin).\n"


def codes(
    folder: Path, *changes: tuple[str, str], rules: str = RULES, problem: str = ""
) -> list[str]:
    """The codes that `check` tells of the cell with changes in its domain."""
    return [each.code for each in told(folder, *changes, rules=rules, problem=problem)]


def told(
    folder: Path, *changes: tuple[str, str], rules: str = RULES, problem: str = ""
) -> tuple[Diagnostic, ...]:
    """What `check` tells of it."""
    text = (CELL / "domain.yaml").read_text("utf-8")
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    (folder / "problems").mkdir(exist_ok=True)
    (folder / "domain.yaml").write_text(text, "utf-8")
    (folder / "rules.lp").write_text(rules, "utf-8")
    goals = problem or "goals:\n  - at(bolt, shelf)\n"
    (folder / "problems" / "p.yaml").write_text(f"problem: p\ndomain: workshop\n{goals}", "utf-8")
    return check_domain_files(str(folder)).diagnostics


def test_the_sound_cell_is_sound(tmp_path: Path) -> None:
    assert codes(tmp_path) == []


@pytest.mark.parametrize(
    ("rules", "found"),
    [
        (RULES.replace("fits(I, P)", "fit(I, P)") + "fits(bolt, shelf).\n", ["K312"]),
        (RULES + "fits_in_hand(I, P) :- fits(I, P).\n", []),
        (RULES.replace("fits(I, P) :-", "spare(I, P) :-") + "fits(I, P) :- spare(I, P).\n", []),
        (RULES + "hme(nut, P) :- place(P), P = shelf.\n", ["K312"]),
        (RULES + "helper(I) :- item(I).\n", []),
    ],
)
def test_rules_for_names_that_are_almost_declared(
    tmp_path: Path, rules: str, found: list[str]
) -> None:
    assert codes(tmp_path, rules=rules) == found


@pytest.mark.parametrize(
    ("problem", "found"),
    [
        ("initial:\n  - at(nut, table)\ngoals:\n  - at(bolt, shelf)\n", ["K314"]),
        ("initial:\n  - at(nut, shelf)\ngoals:\n  - at(bolt, bin)\n", []),
        (
            "initial:\n  - at(nut, shelf)\n  - at(bolt, shelf)\ngoals:\n  - at(bolt, bin)\n",
            ["K314"],
        ),
        ("complete: true\ninitial:\n  - free(bin)\ngoals:\n  - at(bolt, bin)\n", ["K313"]),
        ("complete: true\ninitial:\n  - at(nut, table)\ngoals:\n  - at(bolt, bin)\n", ["K313"]),
        ("complete: true\ninitial:\n  - at(nut, table)\ngoals:\n  - at(nut, table)\n", ["K304"]),
        ("workflow:\n  - stages: at(bolt, shelf), at(bolt, table)\n", []),
    ],
)
def test_initial_states(tmp_path: Path, problem: str, found: list[str]) -> None:
    assert codes(tmp_path, problem=problem) == found


@pytest.mark.parametrize(
    ("full", "other"), list(itertools.permutations(("table", "bin", "shelf"), 2))
)
def test_two_things_are_told_wherever_they_are_and_whatever_is_elsewhere(
    full: str, other: str, tmp_path: Path
) -> None:
    third = ("item: [bolt, nut]", "item: [bolt, nut, pin]")
    given = f"  - at(nut, {full})\n  - at(bolt, {full})\n  - at(pin, {other})\n"
    problem = f"complete: true\ninitial:\n{given}goals:\n  - at(pin, {full})\n"
    (found,) = told(tmp_path, third, problem=problem)
    assert found.code == "K314"
    assert f"but free({full}) allows only one of them" in found.message
    assert found.warning


def test_a_place_that_nothing_needs_to_be_free_takes_several_things(tmp_path: Path) -> None:
    both = "initial:\n  - at(nut, shelf)\n  - at(bolt, shelf)\ngoals:\n  - at(bolt, bin)\n"
    assert "K314" not in codes(
        tmp_path, ("at(Item, From), free(To)", "at(Item, From)"), problem=both
    )


NEEDY = (
    "  move(Item",
    "  call: {adds: alarm}\n  answer: {preconditions: alarm, deletes: alarm}\n"
    "  oil(Item): {preconditions: oiled(Item), deletes: oiled(Item)}\n"
    "  level(Place): {preconditions: zeroed(Place), deletes: zeroed(Place)}\n  move(Item",
)
MORE = (
    "  free(place): {}\n",
    "  free(place): {}\n  alarm: {}\n  oiled(item): {}\n  zeroed(place): {}\n",
)


@pytest.mark.parametrize(
    ("fact", "changes", "hint"),
    [
        ("free(bin)", (), "nothing is true of at(item, place): add such facts under `initial:`"),
        ("at(nut, table)", (), "`cellwright explain` tells what is missing"),
        (
            "free(bin)",
            (MORE, NEEDY),
            "nothing is true of at(item, place), oiled(item), zeroed(place): add such facts "
            "under `initial:`",
        ),
    ],
)
def test_what_is_missing_at_the_start_is_named_and_nothing_else(
    fact: str, changes: tuple[tuple[str, str], ...], hint: str, tmp_path: Path
) -> None:
    problem = f"complete: true\ninitial:\n  - {fact}\ngoals:\n  - at(bolt, bin)\n"
    (found,) = [each for each in told(tmp_path, *changes, problem=problem) if each.code == "K313"]
    assert found.hint == hint
    assert found.warning
    assert "any other problem" not in found.message


def test_two_things_with_one_home_are_told_wherever_they_begin(tmp_path: Path) -> None:
    rules = RULES.replace("home(nut, bin)", "home(nut, table)")
    elsewhere = "initial:\n  - at(nut, shelf)\ngoals:\n  - at(bolt, bin)\n"
    assert codes(tmp_path, rules=rules, problem=elsewhere) == ["K314"]


def test_room_that_is_never_free_again_is_told(tmp_path: Path) -> None:
    assert codes(tmp_path, (GIVEN_BACK, "")) == ["K315"]


def test_room_that_an_operator_gives_back_is_not_told(tmp_path: Path) -> None:
    freed = ("    adds: at(Item, To)\n", "    adds: at(Item, To), free(From)\n")
    assert codes(tmp_path, (GIVEN_BACK, ""), freed) == []


def test_a_missing_type_is_told_once(tmp_path: Path) -> None:
    text = (CELL / "domain.yaml").read_text("utf-8").replace("  item: object\n", "")
    (tmp_path / "domain.yaml").write_text(text, "utf-8")
    (tmp_path / "rules.lp").write_text(RULES, "utf-8")
    with pytest.raises(InvalidInput) as raised:
        load(tmp_path / "domain.yaml")
    (found,) = raised.value.diagnostics
    assert (found.code, found.message) == ("K101", "unknown type 'item'")
    assert found.hint.startswith("declare it under `types:`")


def test_a_name_that_is_unknown_in_many_lines_is_told_once() -> None:
    found = [
        Diagnostic(Source("f", line), "K101", "unknown predicate 'att'", "did you mean 'at'?")
        for line in range(9, 3, -1)
    ]
    (told,) = order_diagnostics(found)
    assert told.where.line == 4
    assert told.hint == "did you mean 'at'?; the same in lines 5, 6, 7 and 2 more"


def test_causes_come_before_what_follows_and_errors_before_warnings() -> None:
    said = ["K304", "K313", "K103", "K101", "K104", "K002"]
    warnings = ("K304", "K313")
    found = [
        Diagnostic(Source("f", line), code, "", "", code in warnings)
        for line, code in enumerate(said, 1)
    ]
    assert [each.code for each in order_diagnostics(found)] == [
        "K002",
        "K104",
        "K101",
        "K103",
        "K313",
        "K304",
    ]


@pytest.mark.parametrize(
    ("name", "hint"),
    [
        ("wrokshop", "did you mean 'workshop'?"),
        ("kitchen", "the domain beside this file is 'workshop'; or a path"),
    ],
)
def test_the_domain_beside_a_problem_is_what_it_may_mean(
    tmp_path: Path, name: str, hint: str
) -> None:
    codes(tmp_path)
    (tmp_path / "problems" / "p.yaml").write_text(
        f"problem: p\ndomain: {name}\ngoals:\n  - free(bin)\n", "utf-8"
    )
    (found,) = check_domain_files(str(tmp_path / "problems" / "p.yaml")).diagnostics
    assert found.hint.startswith(hint)


DERIVED = ("fluents:\n", "derived:\n  away(item): {}\nfluents:\n")


def test_a_goal_that_stands_for_others_is_not_called_out_of_reach(tmp_path: Path) -> None:
    rules = RULES + "away(I) :- at(I, bin), fits(I, bin).\naway(I) :- at(I, shelf).\n"
    found = told(tmp_path, DERIVED, rules=rules, problem="goals:\n  - away(bolt)\n")
    assert [each for each in found if each.code == "K313"] == []
