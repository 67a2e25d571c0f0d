from pathlib import Path

import pytest

from cellwright.engine.authoring import domain_check
from cellwright.engine.authoring.starter import create_domain
from cellwright.engine.pipelines.planning import checked_plan
from cellwright.kb.diagnostics import InvalidInput


@pytest.fixture
def cell(tmp_path: Path) -> Path:
    create_domain(tmp_path / "cell")
    return tmp_path / "cell"


def edit(file: Path, old: str, new: str) -> None:
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new))


def codes(target: Path) -> list[str]:
    return [found.code for found in domain_check.check_domain_files(str(target)).diagnostics]


def test_a_clean_domain_has_no_findings(cell: Path) -> None:
    assert codes(cell) == []


@pytest.mark.parametrize(
    "name",
    [
        "bulkhead",
        *(pytest.param(n, marks=pytest.mark.slow) for n in ("themse", "screening", "elisa")),
    ],
)
def test_the_bundled_domains_have_no_findings(name: str) -> None:
    assert domain_check.check_domain_files(name).diagnostics == ()


def test_a_predicate_that_nothing_uses_is_pointed_at(cell: Path) -> None:
    edit(cell / "domain.yaml", "  free: {}", "  free: {}\n  polished(item): {}")
    assert codes(cell) == ["K309"]


def declared(cell: Path, *predicates: str) -> None:
    """Declare static predicates beside those of the cell."""
    lines = "".join(f"\n  {each}: {{}}" for each in predicates)
    edit(cell / "domain.yaml", "  small(item): {}", f"  small(item): {{}}{lines}")


def ruled(cell: Path, *rules: str) -> None:
    with (cell / "rules.lp").open("a") as file:
        file.write("".join(f"{rule}\n" for rule in rules))


def unused(cell: Path) -> list[str]:
    """The predicates that nothing uses, as `check` says."""
    found = domain_check.check_domain_files(str(cell)).diagnostics
    assert {each.code for each in found} <= {"K309"}
    return [each.message.removeprefix("nothing uses ").strip("'") for each in found]


def test_a_predicate_without_arguments_is_used_by_a_rule(cell: Path) -> None:
    declared(cell, "open_day", "shut_day")
    ruled(cell, "open_day.", ":- open_day, not shut_day.", "shut_day.")
    assert unused(cell) == []


def test_a_name_at_the_end_of_another_is_no_use(cell: Path) -> None:
    declared(cell, "ide(item)", "beside(item)")
    ruled(cell, "beside(I) :- item(I).")
    assert unused(cell) == ["ide"]


def test_a_name_in_a_text_a_comment_or_a_term_is_no_use(cell: Path) -> None:
    declared(cell, "told(item)", "said(item)", "noted(item, text)")
    ruled(cell, "% told(bolt)", 'noted(I, "said(bolt)") :- item(I).')
    assert unused(cell) == ["told", "said"]


@pytest.mark.parametrize(
    "part",
    ["not ide(I)", "#count { J : ide(J) } > 1", "1 { ide(J) : item(J) }", "ide(J) : item(J)"],
)
def test_whatever_a_body_does_with_a_predicate_uses_it(cell: Path, part: str) -> None:
    declared(cell, "ide(item)", "beside(item)")
    ruled(cell, f"beside(I) :- item(I); {part}.")
    assert unused(cell) == []


def test_what_an_operator_counts_is_used(cell: Path) -> None:
    declared(cell, "ide(item)")
    edit(
        cell / "domain.yaml",
        "where: belongs(Item, Bin)",
        'where: "belongs(Item, Bin), #count { I : ide(I) } < 1"',
    )
    assert unused(cell) == []


def test_a_phrase_uses_what_it_names_whole(cell: Path) -> None:
    edit(cell / "domain.yaml", "  free: {}", "  free: {}\n  ide(item): {}\n  beside(item): {}")
    with (cell / "domain.yaml").open("a") as file:
        file.write('    - say: "lay down {I:item}"\n      goal: beside(I)\n')
    assert unused(cell) == ["ide"]


def test_a_condition_that_nothing_makes_true_is_pointed_at(cell: Path) -> None:
    edit(cell / "domain.yaml", "  free: {}", "  free: {}\n  polished(item): {}")
    edit(cell / "domain.yaml", "at(Item, table), free", "at(Item, table), free, polished(Item)")
    assert "K310" in codes(cell)


def test_what_a_cause_makes_true_needs_no_operator(cell: Path) -> None:
    throw = "operators:\n  throw_out(Item):\n    preconditions: odd(Item)\n    adds: free\n"
    edit(cell / "domain.yaml", "  free: {}", "  free: {}\n  odd(item): {}")
    edit(cell / "domain.yaml", "operators:\n", throw)
    assert {"K304", "K310"} <= set(codes(cell))
    edit(
        cell / "faults.yaml",
        "    adds: at(Item, gripper)\n",
        "    adds: at(Item, gripper), odd(Item)\n",
    )
    assert not {"K304", "K310"} & set(codes(cell))


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
    found = [
        each
        for each in domain_check.check_domain_files(str(cell)).diagnostics
        if each.code == "K305"
    ]
    assert ["forget reads at(bolt, gripper)" in each.message for each in found] == [True]


def test_a_violated_constraint_is_reported_at_its_place(cell: Path) -> None:
    with (cell / "rules.lp").open("a") as rules:
        rules.write(":- small(I), small(J), I != J.\n")
    edit(
        cell / "problems" / "two_items.yaml", "  - small(bolt)", "  - small(bolt)\n  - small(plate)"
    )
    (found,) = [
        each
        for each in domain_check.check_domain_files(str(cell)).diagnostics
        if each.code == "K204"
    ]
    assert (Path(found.where.path).name, found.where.line) == ("rules.lp", 4)
    with pytest.raises(InvalidInput, match="K204"):
        checked_plan.plan_problem(
            checked_plan.problem_of(str(cell / "problems" / "two_items.yaml"))
        )


def test_a_predicate_may_be_true_in_very_many_ways(cell: Path) -> None:
    edit(cell / "domain.yaml", "operators:\n", "derived:\n  settled: {}\n\noperators:\n")
    edit(cell / "problems" / "two_items.yaml", "[bolt, plate]", "[i1..12]")
    edit(cell / "problems" / "two_items.yaml", "  - small(bolt)", "  - small(i1)")
    initial = "".join(f"  - at(i{number}, table)\n" for number in range(1, 13))
    text = (cell / "problems" / "two_items.yaml").read_text()
    head, _, _ = text.partition("initial:")
    (cell / "problems" / "two_items.yaml").write_text(
        f"{head}initial:\n{initial}goals:\n  - settled\n"
    )
    with (cell / "rules.lp").open("a") as rules:
        rules.write(
            "unsettled(I) :- item(I), at(I, left).\nunsettled(I) :- item(I), at(I, gripper).\n"
        )
        rules.write(
            "settled :- "
            + ", ".join(f"not unsettled(i{n}), lost(i{n})" for n in range(1, 13))
            + ".\n"
        )
        rules.write("lost(I) :- at(I, table).\nlost(I) :- at(I, right).\n")
    edit(
        cell / "domain.yaml",
        "  settled: {}",
        "  settled: {}\n  unsettled(item): {}\n  lost(item): {}",
    )
    assert not any(code.startswith("K30") for code in codes(cell))
