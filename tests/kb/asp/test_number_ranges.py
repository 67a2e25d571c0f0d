"""Bounds on numbers in static predicates and on ranges hold for whatever clingo derives."""

from math import inf

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from cellwright.kb.asp import Grounder
from cellwright.kb.asp.number_ranges import StaticNumbers
from cellwright.kb.asp.statements import ParsedStatement, read_statements
from cellwright.kb.files import File
from cellwright.kb.model.statement import Statement
from cellwright.kb.terms import Atom, Function, Number

FACTS = (Function("low", (Number(-2),)), Function("low", (Number(1),)))
FACTS += (Function("high", (Number(3),)), Function("pair", (Number(1), Number(4))))
BODIES = ("low(X)", "high(X)", "pair(X, Y)", "pair(Y, X)", "p(X)", "q(X)", "thing(X)")
HEADS = ("p(X)", "q(X)", "q(X + 1)", "q(7)", "p(X..2)", "q(-1..X)", "p(f(X))")
BOUNDS = ("X", "X + 1", "X - 2", "0", "-3", "2 * X", "X -1", "(X)", "Y")


def statements_in(text: str) -> list[Statement]:
    readings = read_statements(text, File.of("rules.lp", text).line)
    return [reading.statement for reading in readings if isinstance(reading, ParsedStatement)]


def numbers_of(facts: tuple[Atom, ...], rules: str) -> StaticNumbers:
    return StaticNumbers(facts, statements_in(rules), ("thing",))


@pytest.mark.parametrize(
    ("rule", "count"),
    [
        ("r(Z) :- low(X), high(Y), Z = X..Y.", 6),
        ("r(1..4).", 4),
        ("r(-3..-2).", 2),
        ("r(Z) :- high(Y), Z = 0..Y-1.", 3),
        ("r(Z) :- low(X), high(Y), Z = X-1..Y+1.", 8),
        ("r(1..2, 1..3).", 6),
        ("r(5..2).", 1),
        ("r(Z) :- low(X), high(Y), Z = X * Y..9.", inf),
        ("r(Z) :- low(X), high(Y), Z = X -1..Y.", 7),
        ("r(Z) :- high(Y), Z = 1..Y * 2.", inf),
        ("r(Z) :- thing(Y), Z = 1..Y.", inf),
        ("r(1..n).", inf),
    ],
)
def test_a_range_has_as_many_values_as_its_bounds_allow(rule: str, count: float) -> None:
    assert numbers_of(FACTS, "").count_range_values(statements_in(rule)[0]) == count


def test_a_name_that_may_stand_for_a_number_leaves_ranges_without_bounds() -> None:
    rule = "r(Z) :- high(Y), Z = 1..Y."
    numbers = numbers_of(FACTS, f"#const three = 3.\n{rule}")
    assert numbers.count_range_values(statements_in(rule)[0]) == inf


@given(st.data())
@settings(max_examples=60, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
def test_no_instance_has_more_values_in_its_range_than_the_bound(data: st.DataObject) -> None:
    bodies = st.lists(st.sampled_from(BODIES), min_size=1, max_size=2)
    rules = ""
    for _ in range(data.draw(st.integers(0, 4))):
        head = data.draw(st.sampled_from(HEADS))
        limit = "" if head.endswith(("(X)", "7)")) else ", X > -6, X < 6"
        rules += f"{head} :- {', '.join(['low(X)', *data.draw(bodies)])}{limit}.\n"
    low, high = data.draw(st.sampled_from(BOUNDS)), data.draw(st.sampled_from(BOUNDS))
    body = ", ".join([data.draw(st.sampled_from(BODIES)), "pair(Y, _)"])
    ranged = f"r(X, Y, Z) :- {body}, Z = {low}..{high}."
    bound = numbers_of(FACTS, rules).count_range_values(statements_in(ranged)[0])
    grounder = Grounder()
    things = "thing(1). thing(9). thing(bolt). "
    grounder.ground(things + " ".join(f"{fact}." for fact in FACTS) + f"\n{rules}{ranged}")
    values: dict[tuple[str, str], int] = {}
    for x, y, _ in grounder.atoms("r", 3):
        values[str(x), str(y)] = values.get((str(x), str(y)), 0) + 1
    assert max(values.values(), default=0) <= bound
