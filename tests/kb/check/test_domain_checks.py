"""Each check of whole domains: what counts as use, as making true, as holding; and what does
not.
"""

from pathlib import Path

import pytest

from cellwright.kb.check import check_domain, unreachable_operators
from cellwright.kb.diagnostics import Diagnostic
from cellwright.kb.loader import load
from cellwright.kb.model.domain_model import Domain
from cellwright.kb.model.planning_problem import Problem

FLUENT = """domain: cell
include: [rules.lp]
types: {item: object}
objects: {item: [bolt]}
statics: {kept(item): {}}
derived: {seen(item): {}}
events: {told(item): {}}
fluents:
  on(item): {}
  spare(item): {}
operators:
  turn(I): {preconditions: "not on(I)", adds: on(I)}
  note(I): {preconditions: "on(I), seen(I)", adds: told(I)}
  keep(I): {where: kept(I), adds: on(I)}
deductive_operators: []
defaults: []
commands:
  words: {item: [item]}
  phrases: []
"""
RULES = "seen(I) :- on(I).\n"
PROBLEM = """problem: task
domain: domain.yaml
initial: []
goals: [on(bolt)]
"""
STATIC = FLUENT.replace("  spare(item): {}\n", "").replace(
    "kept(item): {}", "kept(item): {}, spare(item): {}"
)


@pytest.fixture
def cell(tmp_path: Path) -> "Cell":
    return Cell(tmp_path)


class Cell:
    """Files of a domain and a problem, read from their texts."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def read(
        self, domain: str, rules: str = RULES, problem: str = PROBLEM
    ) -> tuple[Domain, Problem]:
        for name, text in (("domain.yaml", domain), ("rules.lp", rules), ("problem.yaml", problem)):
            (self.folder / name).write_text(text)
        found = load(self.folder / "problem.yaml").problem
        assert found is not None
        return found.domain, found

    def said(self, domain: str, rules: str = RULES, problem: str = PROBLEM) -> list[str]:
        read, posed = self.read(domain, rules, problem)
        return [f"{each.code}: {each.message}" for each in check_domain(read, [posed])]


UNUSED = "K309: nothing uses 'spare'"
NEVER = "K310: 'spare' is a condition, but nothing makes it true"


@pytest.mark.parametrize("domain", [FLUENT, STATIC])
def test_what_nothing_uses_is_pointed_at(cell: Cell, domain: str) -> None:
    assert cell.said(domain) == [UNUSED]


TURN = '  turn(I): {preconditions: "not on(I)", adds: on(I)}\n'
MORE = "deductive_operators: []\n"


@pytest.mark.parametrize(
    ("was", "becomes"),
    [
        (TURN, '  turn(I): {preconditions: "not on(I)", adds: "on(I), spare(I)"}\n'),
        (TURN, '  turn(I): {preconditions: "not on(I)", adds: on(I), deletes: spare(I)}\n'),
        (
            TURN,
            '  turn(I): {preconditions: "not on(I)", effects: [{when: on(I), adds: spare(I)}]}\n',
        ),
        (MORE, "deductive_operators: [{when: on(I), implies: spare(I)}]\n"),
        (MORE, "deductive_operators: [{when: on(I), denies: spare(I)}]\n"),
        (MORE, "deductive_operators: [{when: not spare(I), implies: on(I)}]\n"),
        ("defaults: []", "defaults: [spare(I)]"),
    ],
)
def test_a_fluent_that_something_changes_is_used(cell: Cell, was: str, becomes: str) -> None:
    assert was in FLUENT
    assert cell.said(FLUENT.replace(was, becomes)) == []


@pytest.mark.parametrize(
    ("was", "becomes"),
    [
        (TURN, '  turn(I): {preconditions: "not on(I), spare(I)", adds: on(I)}\n'),
        (TURN, '  turn(I): {preconditions: "not on(I), not spare(I)", adds: on(I)}\n'),
        (
            TURN,
            '  turn(I): {preconditions: "not on(I)", effects: [{when: spare(I), adds: on(I)}]}\n',
        ),
    ],
)
def test_a_fluent_that_is_read_and_never_made_true_is_pointed_at(
    cell: Cell, was: str, becomes: str
) -> None:
    assert was in FLUENT
    assert cell.said(FLUENT.replace(was, becomes)) == [NEVER]


def test_a_fluent_that_a_rule_reads_is_read(cell: Cell) -> None:
    assert cell.said(FLUENT, "seen(I) :- on(I), not spare(I).\n") == [NEVER]


@pytest.mark.parametrize(
    ("was", "becomes", "made"),
    [
        (MORE, "deductive_operators: [{when: on(I), implies: spare(I)}]\n", True),
        (MORE, "deductive_operators: [{when: on(I), denies: spare(I)}]\n", False),
        (MORE, "deductive_operators: [{when: not spare(I), implies: on(I)}]\n", False),
        (
            "  keep(I): {where: kept(I), adds: on(I)}",
            "  keep(I): {where: kept(I), adds: spare(I)}",
            True,
        ),
        (
            "  keep(I): {where: kept(I), adds: on(I)}",
            "  keep(I): {where: kept(I), adds: on(I), deletes: spare(I)}",
            False,
        ),
        ("defaults: []", "defaults: [spare(I)]", True),
    ],
)
def test_what_makes_a_fluent_true(cell: Cell, was: str, becomes: str, made: bool) -> None:
    reading = FLUENT.replace('"not on(I)"', '"not on(I), spare(I)"')
    assert was in reading
    assert cell.said(reading.replace(was, becomes)) == ([] if made else [NEVER])


def test_a_problem_makes_true_what_it_begins_with_and_uses_what_it_wants(cell: Cell) -> None:
    reading = FLUENT.replace('"not on(I)"', '"not on(I), spare(I)"')
    begins = PROBLEM.replace("initial: []", "initial: [spare(bolt)]")
    assert cell.said(reading, problem=begins) == []
    assert cell.said(FLUENT, problem=begins) == []
    assert cell.said(FLUENT, problem=PROBLEM.replace("[on(bolt)]", "[not spare(bolt)]")) == []
    wants = PROBLEM + "statics: [spare(bolt)]\n"
    assert cell.said(STATIC, problem=wants) == []


@pytest.mark.parametrize(
    ("was", "becomes"),
    [
        ("where: kept(I)", 'where: "kept(I), spare(I)"'),
        (MORE, "deductive_operators: [{when: on(I), where: spare(I), implies: on(I)}]\n"),
        (MORE, 'deductive_operators: [{when: on(I), implies: "on(J), spare(J)"}]\n'),
        ("defaults: []", 'defaults: ["on(I), spare(I)"]'),
        (TURN, '  turn(I): {preconditions: "not on(I), spare(I)", adds: on(I)}\n'),
    ],
)
def test_a_static_that_something_reads_is_used(cell: Cell, was: str, becomes: str) -> None:
    assert was in STATIC
    assert cell.said(STATIC.replace(was, becomes)) == []


def test_what_rules_and_phrases_name_is_used(cell: Cell) -> None:
    assert cell.said(STATIC, RULES + "kept(I) :- spare(I).\n") == []
    assert cell.said(STATIC, RULES + "spare(bolt).\n") == []
    assert cell.said(STATIC, "seen(I) :- on(I), spare(I).\n") == []
    phrase = 'phrases: [{say: "spare {I:item}", goal: spare(I)}]'
    assert cell.said(FLUENT.replace("phrases: []", phrase)) == []


def test_a_derived_predicate_is_used_by_its_rule(cell: Cell) -> None:
    assert cell.said(FLUENT.replace("  spare(item): {}\n", "").replace(", seen(I)", "")) == []


# What is reached, what is held.


def test_an_operator_that_nothing_reaches_is_pointed_at_unless_it_waits_for_a_stage(
    cell: Cell,
) -> None:
    domain, _ = cell.read(FLUENT)
    assert unreachable_operators(domain, ["turn", "note", "keep"]) == []
    assert unreachable_operators(domain, ["turn", "keep"]) == []  # `note` tells of an event
    (found,) = unreachable_operators(domain, ["keep"])
    assert (found.code, found.message, found.warning) == (
        "K304",
        "no problem can ever apply turn(I)",
        True,
    )
    assert found.hint
    assert found.where == domain.operators[0].where


HELD = """domain: hold
types: {tool: object}
objects: {tool: [saw, drill]}
fluents: {free(tool): {}, ready: {}, done(tool): {}}
operators:
  one: {preconditions: free(saw), adds: done(saw), resources: saw}
  two: {preconditions: "free(saw), ready", adds: done(saw), resources: saw}
  three: {preconditions: free(saw), adds: "free(saw), ready"}
"""
LOOSE = "three reads free(saw) but does not hold saw; all others that read it do"


def held(text: str, folder: Path) -> list[Diagnostic]:
    (folder / "domain.yaml").write_text(text)
    return [
        each for each in check_domain(load(folder / "domain.yaml").domain) if each.code == "K305"
    ]


def test_an_operator_that_alone_does_not_hold_what_it_reads_is_pointed_at(tmp_path: Path) -> None:
    (found,) = held(HELD, tmp_path)
    assert found.message == LOOSE
    assert found.warning
    assert "add `saw`" in found.hint


@pytest.mark.parametrize(
    ("was", "becomes"),
    [
        ('adds: "free(saw), ready"}', 'adds: "free(saw), ready", resources: saw}'),  # all hold it
        (
            '"free(saw), ready", adds: done(saw), resources: saw',
            '"free(saw), ready", adds: done(saw)',
        ),  # two do not
        # two readers are no habit
        ("  one: {preconditions: free(saw), ", "  one: {preconditions: ready, "),
        (
            "  three: {preconditions: free(saw)",
            "  three: {preconditions: not free(saw)",
        ),  # it reads an absence
    ],
)
def test_where_there_is_no_habit_of_holding_nothing_is_said(
    tmp_path: Path, was: str, becomes: str
) -> None:
    assert was in HELD
    assert held(HELD.replace(was, becomes), tmp_path) == []


def test_atoms_with_variables_name_no_resource(tmp_path: Path) -> None:
    text = (
        HELD.replace("  one:", "  one(T):")
        .replace("  two:", "  two(T):")
        .replace("  three:", "  three(T):")
    )
    assert (
        held(
            text.replace("free(saw)", "free(T)").replace("resources: saw", "resources: T"), tmp_path
        )
        == []
    )


def test_a_warning_points_at_the_declaration(cell: Cell) -> None:
    domain, posed = cell.read(FLUENT.replace('"not on(I)"', '"not on(I), spare(I)"'))
    (found,) = check_domain(domain, [posed])
    assert (found.where, found.warning) == (domain.predicates["spare"].where, True)
    assert found.hint
    domain, posed = cell.read(FLUENT)
    (found,) = check_domain(domain, [posed])
    assert (found.where, found.warning, found.hint) == (
        domain.predicates["spare"].where,
        True,
        "remove it, or use it",
    )
