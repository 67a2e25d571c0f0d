"""A statement says what it defines and uses, whatever its text looks like."""

import pickle

import clingo
import pytest
from clingo import ast
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from cellwright.kb.asp.rule_compiler import NotCompilable, compile_rule
from cellwright.kb.asp.statements import (
    ParsedStatement,
    RefusedStatement,
    RuleReading,
    plain_fact,
    read_rule,
    read_statements,
)
from cellwright.kb.diagnostics import NOWHERE
from cellwright.kb.files import File
from cellwright.kb.model.statement import (
    Constant,
    PredicateUse,
    Sign,
    Statement,
    derivation_statement,
)
from cellwright.kb.syntax import parse_expression
from cellwright.kb.terms import Function, Variable

laws = settings(
    max_examples=60, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck)
)


def read(text: str) -> list[Statement]:
    found = list(read_statements(text, File.of("rules.lp", text).line))
    assert all(isinstance(each, ParsedStatement) for each in found), found
    return [each.statement for each in found if isinstance(each, ParsedStatement)]


def refused(text: str) -> RefusedStatement:
    (found,) = read_statements(text, File.of("rules.lp", text).line)
    assert isinstance(found, RefusedStatement)
    return found


def test_a_rule_tells_its_head_its_uses_and_its_place() -> None:
    _, found = read("item(bolt).\n  heavy(I) :- item(I), not light(I), weight(I, W), W > 2 * 3.")
    assert (found.defines, found.head) == (("heavy", 1), "heavy(I)")
    assert found.uses == (
        PredicateUse(("item", 1), Sign.POSITIVE), PredicateUse(("light", 1), Sign.NEGATIVE), PredicateUse(("weight", 2), Sign.POSITIVE),
    )  # fmt: skip
    assert found.variables == ("I", "I", "I", "I", "W", "W")
    assert (str(found.where), found.is_constraint, found.counts) == ("rules.lp:2:3", False, False)


def test_what_stands_in_an_aggregate_or_a_condition_is_counted() -> None:
    (found,) = read("p :- #count { X : q(X), not r(X) } > 1; 1 { s(X) : t(X) }; u : v; not not w.")
    assert [(use.predicate[0], use.sign) for use in found.uses] == [
        *((name, Sign.COUNTED) for name in "qrstuv"), ("w", Sign.NEGATIVE),
    ]  # fmt: skip


def test_names_in_texts_comments_and_terms_are_no_uses() -> None:
    (found,) = read('p(X) :- q(X, "r(X) :- s.", f(t)). % u(X) :- v.')
    assert [use.predicate for use in found.uses] == [("q", 3)]
    assert found.names == ("p", "q", "f", "t")
    assert found.variables == ("X", "X")


def test_a_constraint_defines_nothing_and_can_be_given_a_head() -> None:
    (found,) = read(":- p(X), q(X); not r : s.")
    assert found.is_constraint
    assert found.defines is None
    assert found.under("wrong(1)") == "wrong(1) :- p(X); q(X); not r: s."
    assert read(found.text) == [found]


def test_a_constant_is_no_constraint() -> None:
    (found,) = read("#const most = 3.")
    assert (found.constant, found.is_constraint, found.defines) == ("most", False, None)


def test_pools_are_written_out_each_with_its_own_arity() -> None:
    found = read("p(a; b, c) :- q((d; e)).")
    assert sorted({each.defines for each in found if each.defines}) == [("p", 1), ("p", 2)]
    assert {each.constants for each in found if each.defines == ("p", 1)} == {
        (Constant(("p", 1), 0, "a"), Constant(("q", 1), 0, name)) for name in ("d", "e")
    }


@pytest.mark.parametrize(
    "text", ["p(X + 1) :- q(X).", "p(1..X) :- q(X).", "p(f(-X)) :- q(X).", "p(|X|) :- q(X)."]
)
def test_a_head_that_computes_counts(text: str) -> None:
    assert read(text)[0].counts


def test_a_dash_in_a_text_does_not_count() -> None:
    assert not read('p(X, "half-open..") :- q(X), X > 1 + 1.')[0].counts


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("-p(X) :- q(X).", "classical negation"),
        ("p :- not -q.", "classical negation"),
        ("p :- #count { X : -q(X) } > 1.", "classical negation"),
        ("p(@f(1)).", "external functions"),
        ("p(1..1000000000).", "a range of more"),
        ("{ p } :- q.", "one atom"),
        ("not p :- q.", "one atom"),
        ("p ; q.", "one atom"),
        ("#show p/1.", "#show"),
    ],
)
def test_what_the_language_lacks_is_refused(text: str, said: str) -> None:
    assert said in refused(text).message


def test_a_statement_is_equal_by_its_text_and_can_be_pickled() -> None:
    (found,) = read("p(X) :- q(X).")
    (other,) = read("\n\n p(X) :-   q(X).")
    assert (found, hash(found)) == (other, hash(other))
    assert found.where != other.where
    copy = pickle.loads(pickle.dumps(found))
    assert (copy, copy.uses, copy.where) == (found, found.uses, found.where)


def test_a_derivation_is_what_its_text_reads_as() -> None:
    value = (Variable("X"),)
    made = derivation_statement(
        Function("either", value), [Function("left", value), Function("right", value)]
    )
    (found,) = read(made.text)
    assert all(
        getattr(made, name) == getattr(found, name)
        for name in Statement.__slots__
        if name != "where"
    )


names = st.sampled_from(["p", "q", "ide", "beside"])
variable = st.sampled_from(["X", "Y"])
constant = st.sampled_from(["a", "b", "1", "2", '"ide(a)"', '"p :- q."'])
term = st.one_of(variable, constant, variable.map("f({})".format), variable.map("({}+1)".format))
atom = st.builds(lambda name, arguments: f"{name}({','.join(arguments)})" if arguments else name,
                 names, st.lists(term, max_size=2))  # fmt: skip
safe = "d(X), d(Y)"
part = st.one_of(
    atom,
    atom.map("not {}".format),
    atom.map("#count {{ Z : d(Z), {} }} >= 1".format),
    atom.map("{} : d(Z)".format),
    st.builds("{} <= {}".format, term, term),
)
rules = st.builds(lambda head, parts: f"{head} :- {'; '.join([safe.replace(', ', '; '), *parts])}.",
                  st.one_of(st.just(""), atom), st.lists(part, max_size=3))  # fmt: skip


def nodes(text: str) -> list[ast.AST]:
    found: list[ast.AST] = []
    ast.parse_string(text, found.append)
    return found[1:]


def signatures(node: ast.AST) -> set[tuple[str, int]]:
    """The predicates of a tree, the slow way: every symbolic atom, by a transformer."""
    found = set()

    class Collector(ast.Transformer):
        def visit_SymbolicAtom(self, atom: ast.AST) -> ast.AST:
            symbol = clingo.parse_term(
                str(atom.symbol).translate(str.maketrans("XYZ", "xyz")).replace("+1", "")
            )
            found.add((symbol.name, len(symbol.arguments)))
            return atom

    Collector().visit(node)
    return found


@laws
@given(st.lists(rules, min_size=1, max_size=4))
def test_heads_and_uses_are_those_of_the_tree(texts: list[str]) -> None:
    for made, node in zip(read("\n".join(texts)), nodes("\n".join(texts)), strict=True):
        body = {each for part in node.body for each in signatures(part)}
        head = signatures(node.head)
        assert {use.predicate for use in made.uses} == body
        assert ({made.defines} if made.defines else set()) == head
        assert made.text == str(node)
        assert made.under(made.head or "#false") == made.text


def answer(text: str) -> set[str]:
    """The true atoms of a program without choices, or one mark if a constraint is violated."""
    control = clingo.Control(["--warn=none"])
    control.add("base", [], text)
    control.ground([("base", [])])
    with control.solve(yield_=True) as models:
        for model in models:
            return {str(symbol) for symbol in model.symbols(atoms=True)}
    return {"violated"}


@laws
@given(rules, st.lists(names, max_size=3), st.data())
def test_facts_of_a_predicate_that_a_rule_does_not_use_change_nothing(
    text: str, given_names: list[str], data: st.DataObject
) -> None:
    (made,) = read(text)
    facts = "d(a). d(1). " + " ".join(f"{name}. {name}(a). {name}(1,f(a))." for name in given_names)
    used = {use.predicate for use in made.uses}
    unused = [(name, arity) for name in ("p", "q", "ide", "beside") for arity in range(3)]
    name, arity = data.draw(st.sampled_from([each for each in unused if each not in used]))
    more = f"{name}({','.join(['b'] * arity)})" if arity else name
    assert answer(f"{text} {facts} {more}.") | {more} == answer(f"{text} {facts}") | {more}


@laws
@given(st.builds(lambda name, arguments: f"{name}({','.join(arguments)})" if arguments else name,
                 names, st.lists(st.sampled_from(["a", "b1", "0", "42"]), max_size=3)))  # fmt: skip
def test_the_short_way_reads_a_fact_as_its_tree_does(text: str) -> None:
    (node,) = nodes(f"{text}.")
    short, long = plain_fact(str(node), NOWHERE), read_rule(node, NOWHERE, RuleReading())
    assert short is not None
    assert isinstance(long, ParsedStatement)
    assert all(
        getattr(short, name) == getattr(long.statement, name) for name in Statement.__slots__
    )


plain_term = st.one_of(
    variable, constant, variable.map("f({})".format), variable.map("({}+1)".format)
)
plain_part = st.one_of(
    atom, atom.map("not {}".format), st.builds("{} != {}".format, plain_term, plain_term)
)


@laws
@given(atom, st.lists(plain_part, min_size=1, max_size=3))
def test_a_rule_is_compiled_to_what_the_grammar_of_expressions_reads(
    head: str, parts: list[str]
) -> None:
    (node,) = nodes(f"{head} :- {'; '.join(parts)}.")
    assert compile_rule(node) == (
        parse_expression("atom", head).value,
        parse_expression("body", ", ".join(parts)).value,
    )


@pytest.mark.parametrize(
    "part",
    ["#sum+ { X : q(X) } > "
    "1", "{ q(X) } > "
    "1", "#count { X : q(X) "
    "}", "q(1..2)", "q(|X|)", "not X = 1", "1 < X < 3", "q(X) : r(X)", "#true", "not not q",
     "q((X, 1))", "q(X**2)", "q(#sup)"],
)  # fmt: skip
def test_a_rule_that_the_model_cannot_hold_is_not_compiled(part: str) -> None:
    (node,) = nodes(f"p :- {part}.")
    with pytest.raises(NotCompilable):
        compile_rule(node)
