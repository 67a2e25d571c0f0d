"""MACROPs for the tests of stores: random ones, and small ones that differ in what they are
told to.
"""

from hypothesis import strategies as st

from cellwright.kb.model.conditions import Comparison, Literal, Parameter
from cellwright.kb.model.plan_model import (
    CausalLink,
    MacroChain,
    Macrop,
    MacroPart,
    MacroStep,
    StepId,
)
from cellwright.kb.terms import Function, Number, Operation, Term, Text, Variable

names = st.sampled_from(["at", "holding", "m1", "free", "x_2", "_where_ab12"])
variable_names = st.sampled_from(["Arm1", "X", "Place_2", "_Any1__0", "W1"])
texts = st.text(st.characters(codec="utf-8"), max_size=6)
leaves: st.SearchStrategy[Term] = st.one_of(
    st.builds(Function, names),
    st.builds(Variable, variable_names),
    st.builds(Number, st.integers(-(2**31), 2**31 - 1)),
    st.builds(Text, texts),
)
terms: st.SearchStrategy[Term] = st.recursive(
    leaves,
    lambda inner: st.one_of(
        st.builds(Function, names, st.lists(inner, min_size=1, max_size=3).map(tuple)),
        st.builds(Function, st.just(""), st.lists(inner, min_size=2, max_size=3).map(tuple)),
        st.builds(Operation, st.sampled_from("+-*/"), inner, inner),
    ),
    max_leaves=6,
)
atoms = st.builds(Function, names, st.lists(terms, max_size=3).map(tuple))
literals = st.builds(Literal, atoms, st.booleans())
comparisons = st.builds(
    Comparison, terms, st.sampled_from(["=", "!=", "<", "<=", ">", ">="]), terms
)
parts = st.one_of(literals, comparisons)
ids = st.integers(1, 9).map(StepId)


def tuples(inner: st.SearchStrategy[object]) -> st.SearchStrategy[tuple[object, ...]]:
    return st.lists(inner, max_size=3).map(tuple)


macrops = st.builds(
    Macrop,
    name=atoms,
    domain=st.sampled_from(["bulkhead", "themse"]),
    goals=tuples(literals),
    preconditions=tuples(literals),
    adders=tuples(atoms),
    types=st.lists(
        st.builds(Parameter, st.builds(Variable, variable_names), st.sampled_from(["arm", "tool"])),
        max_size=3,
        unique=True,
    ).map(lambda found: tuple(sorted(found, key=lambda each: each.variable.name))),
    constraints=tuples(parts),
    disequalities=tuples(comparisons),
    exclusions=tuples(st.lists(parts, max_size=2).map(tuple)),
    resources=tuples(terms),
    steps=st.lists(
        st.builds(MacroStep, ids, atoms, tuples(ids), tuples(terms), terms, terms),
        min_size=1,
        max_size=3,
    ).map(tuple),
    links=tuples(st.builds(CausalLink, ids, atoms, ids)),
    chains=tuples(st.builds(MacroChain, terms, tuples(atoms), tuples(terms), st.none() | terms)),
    parts=tuples(st.builds(MacroPart, st.sampled_from(["heated", "measured"]), tuples(ids))),
    depends=st.dictionaries(
        st.sampled_from(["operator move", "type arm"]), st.sampled_from(["a1", "b2"])
    ),
)


def macrop(name: str, domain: str = "bulkhead", **depends: str) -> Macrop:
    """A MACROP of one step that rests on the operators named, by digest."""
    step = MacroStep(StepId(1), Function(name))
    rests = {f"operator {operator}": digest for operator, digest in depends.items()}
    return Macrop(Function(name), domain, (), (), (), (), (), (), (), (), (step,), (), (), rests)
