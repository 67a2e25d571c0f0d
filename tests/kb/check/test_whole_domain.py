from pathlib import Path

import pytest

from engine.authoring.starter import create
from engine.pipelines import checking, planning
from kb.diagnostics import InvalidInput


@pytest.fixture
def cell(tmp_path: Path) -> Path:
    create(tmp_path / "cell")
    return tmp_path / "cell"


def edit(file: Path, old: str, new: str) -> None:
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new))


def codes(target: Path) -> list[str]:
    return [found.code for found in checking.check(str(target)).diagnostics]


def test_a_clean_domain_has_no_findings(cell: Path) -> None:
    assert codes(cell) == []


@pytest.mark.parametrize("name", ["bulkhead", "themse"])
def test_the_bundled_domains_have_no_findings(name: str) -> None:
    assert checking.check(name).diagnostics == ()


def test_a_predicate_that_nothing_uses_is_pointed_at(cell: Path) -> None:
    edit(cell / "domain.yaml", "  free: {}", "  free: {}\n  polished(item): {}")
    assert codes(cell) == ["K309"]


def test_a_condition_that_nothing_makes_true_is_pointed_at(cell: Path) -> None:
    edit(cell / "domain.yaml", "  free: {}", "  free: {}\n  polished(item): {}")
    edit(cell / "domain.yaml", "at(Item, table), free", "at(Item, table), free, polished(Item)")
    assert "K310" in codes(cell)


def test_an_operator_that_no_problem_can_apply_is_pointed_at(cell: Path) -> None:
    edit(cell / "domain.yaml", "where: belongs(Item, Bin)", "where: belongs(Item, Bin), Item = Bin")
    assert "K304" in codes(cell)


def test_an_operator_that_reads_what_all_its_kin_hold_is_pointed_at(cell: Path) -> None:
    edit(
        cell / "domain.yaml",
        "  swing(Bin",
        "\n".join(
            [
                "  wave:",
                "    preconditions: at(bolt, gripper)",
                "    adds: free",
                "    resources: gripper",
                "  shake:",
                "    preconditions: at(bolt, gripper)",
                "    adds: free",
                "    resources: gripper",
                "  forget:",
                "    preconditions: at(bolt, gripper)",
                "    adds: free",
                "  swing(Bin",
            ]
        ),
    )
    edit(cell / "domain.yaml", "  bin: [left, right]", "  bin: [left, right]\n  item: [bolt]")
    edit(cell / "problems" / "two_items.yaml", "[bolt, plate]", "[plate]")
    found = [each for each in checking.check(str(cell)).diagnostics if each.code == "K305"]
    assert ["forget reads at(bolt, gripper)" in each.message for each in found] == [True]


def test_a_violated_constraint_is_reported_at_its_place(cell: Path) -> None:
    with (cell / "rules.lp").open("a") as rules:
        rules.write(":- small(I), small(J), I != J.\n")
    edit(cell / "problems" / "two_items.yaml", "  - small(bolt)", "  - small(bolt)\n  - small(plate)")
    (found,) = [each for each in checking.check(str(cell)).diagnostics if each.code == "K204"]
    assert (Path(found.where.path).name, found.where.line) == ("rules.lp", 4)
    with pytest.raises(InvalidInput, match="K204"):
        planning.plan(planning.problem_of(str(cell / "problems" / "two_items.yaml")))


def test_a_predicate_with_too_many_supports_is_reported_at_its_rule(cell: Path) -> None:
    edit(cell / "domain.yaml", "operators:\n", "derived:\n  settled: {}\n\noperators:\n")
    edit(cell / "problems" / "two_items.yaml", "[bolt, plate]", "[i1..12]")
    edit(cell / "problems" / "two_items.yaml", "  - small(bolt)", "  - small(i1)")
    initial = "".join(f"  - at(i{number}, table)\n" for number in range(1, 13))
    text = (cell / "problems" / "two_items.yaml").read_text()
    head, _, _ = text.partition("initial:")
    (cell / "problems" / "two_items.yaml").write_text(f"{head}initial:\n{initial}goals:\n  - settled\n")
    with (cell / "rules.lp").open("a") as rules:
        rules.write("unsettled(I) :- item(I), at(I, left).\nunsettled(I) :- item(I), at(I, gripper).\n")
        rules.write(
            "settled :- " + ", ".join(f"not unsettled(i{n}), lost(i{n})" for n in range(1, 13)) + ".\n"
        )
        rules.write("lost(I) :- at(I, table).\nlost(I) :- at(I, right).\n")
    edit(cell / "domain.yaml", "  settled: {}", "  settled: {}\n  unsettled(item): {}\n  lost(item): {}")
    assert "K306" in codes(cell)
