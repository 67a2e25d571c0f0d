"""What the loader makes of files: types inferred, conditions in scope, names, ranges, and
places in files.
"""

from pathlib import Path

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from cellwright.engine.model.outcome import Found, Infeasible
from cellwright.engine.pipelines.planning import checked_plan
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source
from cellwright.kb.files import MAX_EXCERPT_CHARACTERS, File
from cellwright.kb.loader import load, with_goals
from cellwright.kb.loader.yaml_tree import read_tree
from cellwright.kb.model.conditions import Aggregate, And, Exists, ForAll, Literal, Not, Or
from cellwright.kb.model.domain_model import Domain, Kind
from cellwright.kb.syntax import ExpressionError, parse_expression
from cellwright.kb.terms import Variable

BASE = """domain: store
include: [rules.lp]
types:
  place: object
  shelf: place
  item: object
  cup: item
objects:
  shelf: [low, high]
  place: [table]
statics:
  weight(item, int): {}
derived:
  heavy(item): {}
  loose(item): {}
fluents:
  at(item, place): {}
  clean(item): {}
operators:
  put(Item, From, To):
    where: From != To, weight(Item, W), W < 9
    preconditions: at(Item, From)
    adds: at(Item, To)
deductive_operators:
  - when: at(Item, Place)
    denies: at(Item, Other), Other != Place
"""
RULES = "heavy(I) :- weight(I, W), W > 5.\nloose(I) :- at(I, P), not shelf(P).\n"


def domain(folder: Path, extra: str = "", rules: str = "") -> Domain:
    (folder / "domain.yaml").write_text(BASE.replace("operators:\n", f"operators:\n{extra}", 1))
    (folder / "rules.lp").write_text(RULES + rules)
    return load(folder / "domain.yaml").domain


def test_types_of_variables_come_from_the_atoms_they_stand_in(tmp_path: Path) -> None:
    (operator,) = domain(tmp_path).operators
    assert [parameter.type for parameter in operator.parameters] == ["item", "place", "place"]


def test_the_narrowest_of_several_types_is_taken(tmp_path: Path) -> None:
    extra = "  shelve(Item, To):\n    where: cup(Item), shelf(To)\n    adds: at(Item, To)\n"
    operator = domain(tmp_path, extra).operators[0]
    assert [parameter.type for parameter in operator.parameters] == ["cup", "shelf"]


def test_a_negated_atom_does_not_narrow(tmp_path: Path) -> None:
    extra = "  move(Item, To):\n    where: not shelf(To)\n    adds: at(Item, To)\n"
    operator = domain(tmp_path, extra).operators[0]
    assert [parameter.type for parameter in operator.parameters] == ["item", "place"]


def test_a_derived_predicate_over_statics_alone_is_static(tmp_path: Path) -> None:
    predicates = domain(tmp_path).predicates
    assert (predicates["heavy"].kind, predicates["loose"].kind) == (Kind.STATIC, Kind.DERIVED)


def test_a_universal_condition_quantifies_the_variables_of_its_own_alone(tmp_path: Path) -> None:
    extra = """  leave(Place):
    preconditions: "clean(I) : at(I, Place)"
    effects:
      - {when: clean(I), adds: "at(I, Place)"}
"""
    operator = domain(tmp_path, extra).operators[0]
    (condition,) = operator.precondition.parts if isinstance(operator.precondition, And) else ()
    assert isinstance(condition, ForAll)
    assert [str(parameter) for parameter in condition.parameters] == ["I: item"]


PROBLEM = """problem: p
domain: store
objects:
  cup: [c1, c2]
statics:
  - weight(c1, 1), weight(c2, 1)
initial:
  - at(c1, table), at(c2, low)
"""


@pytest.mark.parametrize(
    ("goal", "feasible"),
    [
        ("shelf(P) : at(c1, P)", True),
        ("at(c1, P) : shelf(P)", False),
        ("at(I, high) : cup(I)", True),
        ("at(c1, low) | at(c1, high), at(c2, table)", True),
        ("at(c1, low), at(c1, high)", False),
        ("not at(c1, table), not at(c1, low)", True),
        ("at(_, high), not at(_, low)", True),
    ],
)
def test_goals_mean_what_they_say(goal: str, feasible: bool, tmp_path: Path) -> None:
    domain(tmp_path)
    (tmp_path / "p.yaml").write_text(PROBLEM + f"goals: ['{goal}']\n")
    outcome = checked_plan.plan_problem(checked_plan.problem_of(str(tmp_path / "p.yaml")))
    assert isinstance(outcome, Found if feasible else Infeasible)


@pytest.mark.parametrize(("dirty", "feasible"), [("low", True), ("table", False)])
def test_a_universal_precondition_reads_the_variables_of_its_operator(
    dirty: str, feasible: bool, tmp_path: Path
) -> None:
    """Everything at the place that is left must be clean, not everything at any place."""
    extra = """operators:
  seal(Place):
    types: {Place: place}
    where: Place = table
    preconditions: "clean(I) : at(I, Place)"
    adds: sealed
"""
    text = BASE.replace("  clean(item): {}\n", "  clean(item): {}\n  sealed: {}\n")
    text = text[: text.index("operators:")] + extra
    (tmp_path / "domain.yaml").write_text(text)
    (tmp_path / "rules.lp").write_text(RULES)
    other = "table" if dirty == "low" else "low"
    (tmp_path / "p.yaml").write_text(
        "problem: p\ndomain: store\nobjects:\n  cup: [c1, c2]\ncomplete: true\n"
        f"initial:\n  - at(c1, {dirty}), at(c2, {other}), clean(c2)\ngoals: [sealed]\n"
    )
    outcome = checked_plan.plan_problem(checked_plan.problem_of(str(tmp_path / "p.yaml")))
    assert isinstance(outcome, Found if feasible else Infeasible)


def test_ranges_are_written_out(tmp_path: Path) -> None:
    (tmp_path / "domain.yaml").write_text(
        "domain: d\ntypes:\n  t: object\nobjects:\n  t: [a_8..11, b01..02, c1..c3]\n"
    )
    found = list(load(tmp_path / "domain.yaml").domain.objects)
    assert found == ["a_8", "a_9", "a_10", "a_11", "b01", "b02", "c1", "c2", "c3"]


def test_times_count_the_unit_of_the_domain(tmp_path: Path) -> None:
    text = (
        "domain: d\nunits: {time: UNIT}\nfluents:\n  f: {}\noperators:\n  o:\n    adds: f\n    "
        "duration: 1.5 h\n"
    )
    for unit, count in (("ms", 5_400_000), ("s", 5400), ("min", 90)):
        (tmp_path / "domain.yaml").write_text(text.replace("UNIT", unit))
        assert str(load(tmp_path / "domain.yaml").domain.operators[0].duration) == str(count)
    (tmp_path / "domain.yaml").write_text(text.replace("UNIT", "h"))
    with pytest.raises(InvalidInput, match="K113"):
        load(tmp_path / "domain.yaml")


def test_goals_given_elsewhere_are_checked_at_their_place(tmp_path: Path) -> None:
    with pytest.raises(InvalidInput) as raised:
        with_goals(domain(tmp_path), "at(cup_9, low)")
    (found,) = raised.value.diagnostics
    assert (found.where.path, found.where.column, found.code) == ("--goals", 4, "K101")


def test_some_and_none(tmp_path: Path) -> None:
    goal = with_goals(domain(tmp_path), "at(_, low), not clean(_)").goal
    assert isinstance(goal, And)
    some, none = goal.parts
    assert isinstance(some, Exists)
    assert isinstance(none, Not)
    assert isinstance(none.part, Exists)
    assert isinstance(some.part, Literal)


@given(
    st.text(st.characters(codec="ascii", exclude_categories=["Cc"]) | st.just("\n"), max_size=40)
)
def test_a_place_in_a_quoted_text_is_that_of_the_same_character(text: str) -> None:
    written = "key: '" + text.replace("'", "").replace("\n", "\n\n  ") + "'\n"
    root, _ = read_tree(File.of("file", written))
    node = root.descend(("key",))
    for offset, character in enumerate(node.value):
        if not character.isspace():
            where = node.place(offset)
            line = written.split("\n")[where.line - 1]
            assert line[where.column - 1] == character


names = st.from_regex(r"[a-z][A-Za-z0-9_]{0,6}", fullmatch=True)


@given(
    st.recursive(
        names, lambda inner: st.lists(inner, max_size=3) | st.dictionaries(names, inner, max_size=3)
    )
)
def test_the_tree_of_a_file_is_what_was_written(content: object) -> None:
    root, found = read_tree(File.of("file", yaml.safe_dump({"top": content})))
    assert not found
    assert root.plain() == {"top": content}


@given(st.integers(0, 3000), st.integers(1, 3000))
def test_the_caret_stands_under_its_character(before: int, after: int) -> None:
    file = File.of("file", "x" * before + "!" + "x" * after)
    shown, caret = file.at(before).excerpt()
    assert shown[len(caret) - 1] == "!"
    assert len(shown) <= 2 * MAX_EXCERPT_CHARACTERS + 3


def test_a_caret_follows_tabs_and_wide_letters() -> None:
    shown, caret = Source("file", 1, 4, "\t漢!x").excerpt()
    assert (shown, caret) == ("\t漢!x", "\t   ^")


def test_a_message_has_place_severity_code_line_caret_and_hint() -> None:
    text = str(
        Diagnostic(Source("f.yaml", 3, 5, "    at(X)"), "K101", "unknown", "try this", warning=True)
    )
    assert text == "f.yaml:3:5: warning K101: unknown\n        at(X)\n        ^\n  try: try this"


def test_alternatives_and_universal_conditions_are_parsed() -> None:
    either, every, plain = parse_expression("conditions", "a(X) | not b(X), p(Y) : q(Y), c").value
    assert isinstance(either, Or)
    assert isinstance(every, ForAll)
    assert isinstance(plain, Literal)


@pytest.mark.parametrize(
    "text", ["a(X) | b(X) : c(X)", "a(X) : b(X) : c(X)", "| a", "a |", ": a", "a,", "a b", "1", "X"]
)
def test_conditions_that_are_none(text: str) -> None:
    with pytest.raises(ExpressionError):
        parse_expression("conditions", text)


@pytest.mark.parametrize(
    ("start", "text"), [("term", "|T - 10|"), ("body", "|T - 10| < 3"), ("body", "X < 2, 3 < |T|")]
)
def test_an_absolute_value_is_told_where_it_is_known(start: str, text: str) -> None:
    with pytest.raises(ExpressionError) as refused:
        parse_expression(start, text)
    assert ".lp files" in refused.value.hint


def test_a_bar_behind_an_atom_is_told_as_a_choice() -> None:
    with pytest.raises(ExpressionError) as refused:
        parse_expression("atoms", "a(X) | b(X)")
    assert "between atoms of a condition" in refused.value.hint


def codes(folder: Path, rules: str) -> list[tuple[str, int]]:
    """What a load finds in the rules: codes and lines."""
    try:
        domain(folder, rules=rules)
    except InvalidInput as error:
        return [(each.code, each.where.line) for each in error.diagnostics]
    return []


def test_a_text_in_a_rule_hides_no_mistake_beside_it(tmp_path: Path) -> None:
    assert codes(tmp_path, 'odd(I, "why") :- heavy(I), weight(table, 3).\n') == [("K103", 3)]
    assert codes(tmp_path, 'odd(I, "weight(table, 3)", _x) :- heavy(I).\n') == [("K112", 3)]


def test_a_term_beside_a_constant_hides_no_mistake(tmp_path: Path) -> None:
    assert codes(tmp_path, "odd(I) :- heavy(I), weight(table, 3 + 1).\n") == [("K103", 3)]


def test_a_rule_over_fluents_may_count(tmp_path: Path) -> None:
    assert codes(tmp_path, "loose(I) :- at(I, table), #count { J : at(J, table) } > 1.\n") == []


def test_an_aggregate_knows_its_variables_and_what_it_counts(tmp_path: Path) -> None:
    where = (
        '    where: "weight(Item, W), #count { J, \\"K\\" : weight(J, W), not shelf(J) } == N, '
        'N < 3"\n'
    )
    made = domain(
        tmp_path, f"  wash(Item):\n{where}    preconditions: at(Item, _)\n    adds: clean(Item)\n"
    )
    (aggregate,) = (part for part in made.operators[0].body if isinstance(part, Aggregate))
    assert aggregate.uses == (("weight", 2), ("shelf", 1))
    assert aggregate.binds == Variable("N")
    assert sorted(map(str, aggregate.standing)) == ["J", "J", "J", "N", "W"]


def test_computed_values_inside_atoms_get_names_and_nothing_else_changes(tmp_path: Path) -> None:
    where = "    where: weight(Item, W), weight(_, W + 1), not weight(Item, W * 2), W < 3 - 1\n"
    made = domain(
        tmp_path, f"  wash(Item):\n{where}    preconditions: at(Item, _)\n    adds: clean(Item)\n"
    )
    assert [str(part) for part in made.operators[0].body] == [
        "weight(Item, W)",
        "weight(_, _Value__1)",
        "not weight(Item, _Value__2)",
        "W < (3-1)",
        "_Value__1 = (W+1)",
        "_Value__2 = (W*2)",
    ]
    assert made.operators[1].body == domain(tmp_path).operators[0].body
