"""Random small problems, and brute force over the domain's own meaning.

Strategies are made once for each choice of terms: hypothesis looks a new one through before it
draws from it.
"""

import functools
import itertools
from collections import deque
from collections.abc import Iterator

from hypothesis import strategies as st

from cellwright.engine.stages.validation.condition_solving import condition_holds
from cellwright.engine.stages.validation.operator_semantics import Semantics
from cellwright.engine.stages.validation.step_changes import State
from cellwright.kb.model.conditions import (
    ALWAYS_TRUE,
    And,
    Condition,
    Exists,
    ForAll,
    Literal,
    Not,
    Or,
    Parameter,
)
from cellwright.kb.model.domain_model import (
    Consequence,
    DeductiveOperator,
    Domain,
    Effect,
    Kind,
    Operator,
    Predicate,
    Rule,
    Type,
)
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Atom, Function, Term, Variable

X, Y = Variable("X"), Variable("Y")
OBJECTS = ("a", "b")
TYPES = {"thing": Type("thing")}
PREDICATES = {
    "p": Predicate("p", ("thing",), Kind.FLUENT),
    "q": Predicate("q", ("thing",), Kind.FLUENT),
    "r": Predicate("r", (), Kind.FLUENT),
    "d": Predicate("d", ("thing",), Kind.DERIVED),
    "e": Predicate("e", (), Kind.DERIVED),
}
ONE_X, ONE_Y = (Parameter(X, "thing"),), (Parameter(Y, "thing"),)


@functools.cache
def atoms(terms: tuple[Term, ...], derived: bool = False) -> st.SearchStrategy[Atom]:
    names = ["p", "q", "d"] if derived else ["p", "q"]
    plain = [Function("r"), *([Function("e")] if derived else [])]
    return st.sampled_from([*(Function(n, (t,)) for n in names for t in terms), *plain])


@functools.cache
def literals(terms: tuple[Term, ...], derived: bool = False) -> st.SearchStrategy[Literal]:
    return st.builds(Literal, atoms(terms, derived), st.booleans())


@functools.cache
def conditions(terms: tuple[Term, ...], derived: bool = True) -> st.SearchStrategy[Condition]:
    """Conjunctions of literals, disjunctions, and quantified literals."""
    plain = literals(terms, derived)
    inner = literals((*terms, Y), derived)
    part: st.SearchStrategy[Condition] = st.one_of(
        plain,
        plain,
        st.builds(lambda one, other: Or((one, other)), plain, plain),
        st.builds(lambda part: ForAll(ONE_Y, part), inner),
        st.builds(lambda part: Exists(ONE_Y, part), inner),
        st.builds(lambda one, other: Not(And((one, other))), plain, plain),
    )
    return st.builds(lambda parts: And(tuple(parts)), st.lists(part, max_size=2))


@functools.cache
def resources(with_argument: bool) -> st.SearchStrategy[list[Term]]:
    """What a step may hold: an arm, an oven, a thing, or what its operator is applied to."""
    named: list[Term] = [Function("arm"), Function("oven"), Function("a")]
    return st.lists(
        st.sampled_from([*named, *([X] if with_argument else [])]), max_size=2, unique=True
    )


CONSTANTS: tuple[Term, ...] = tuple(Function(name) for name in OBJECTS)


@functools.cache
@st.composite
def operators(draw: st.DrawFn, name: str, conditional: bool) -> Operator:
    parameters = draw(st.sampled_from([(), ONE_X]))
    terms = (*CONSTANTS, *((X,) if parameters else ()))
    effects = [
        Effect(a, True)
        for a in draw(st.lists(atoms(terms), min_size=0 if conditional else 1, max_size=2))
    ]
    effects += [Effect(a, False) for a in draw(st.lists(atoms(terms), max_size=2))]
    if conditional:
        local = draw(st.sampled_from([(), ONE_Y]))
        inner = (*terms, *((Y,) if local else ()))
        for _ in range(draw(st.integers(0, 1))):
            when = And(tuple(draw(st.lists(literals(inner), min_size=1, max_size=2))))
            effects.append(Effect(draw(atoms(inner)), draw(st.booleans()), local, when))
    held = tuple(draw(resources(X in terms)))
    return Operator(
        name, parameters, draw(conditions(terms)), tuple(effects), resources=held, cost=None
    )


@functools.cache
@st.composite
def rules(draw: st.DrawFn) -> tuple[Rule, ...]:
    """Stratified rules: `d` over fluents and itself, `e` over fluents and `d`."""
    body = st.lists(literals((X,)), min_size=1, max_size=2)
    thing = Literal(Function("thing", (X,)))
    found = [
        Rule(Function("d", (X,)), (thing, *parts)) for parts in draw(st.lists(body, max_size=2))
    ]
    if draw(st.booleans()):
        found.append(
            Rule(
                Function("d", (X,)),
                (thing, Literal(Function("d", (Function("a"),))), Literal(Function("r"))),
            )
        )
    more = st.lists(literals((Function("a"),), derived=False), max_size=1)
    last = Literal(Function("d", (Function("b"),)))
    found += [Rule(Function("e"), (last, *parts)) for parts in draw(st.lists(more, max_size=1))]
    if draw(st.booleans()):
        found.append(Rule(Function("e"), (Literal(last.atom, False), Literal(Function("r")))))
    return tuple(found)


@functools.cache
@st.composite
def deductive_operators(draw: st.DrawFn) -> tuple[DeductiveOperator, ...]:
    found = []
    for _ in range(draw(st.integers(0, 3))):
        trigger = draw(st.sampled_from([Function("p", (X,)), Function("q", (X,)), Function("r")]))
        parameters = ONE_X if trigger.arguments else ()
        terms = (X,) if parameters else CONSTANTS
        consequence = Consequence(draw(atoms(terms)), draw(st.booleans()), (), parameters)
        sign = draw(st.sampled_from([True, True, False]))
        found.append(DeductiveOperator(Literal(trigger, sign), parameters, (), (consequence,)))
    return tuple(found)


@st.composite
def problems(draw: st.DrawFn, conditional: bool = False, deductive: bool = False) -> Problem:
    """Two things, five fluents, up to three operators, derived predicates; a whole initial
    state.
    """
    count = draw(st.integers(1, 3))
    made = tuple(draw(operators(f"o{number}", conditional)) for number in range(count))
    domain = Domain(
        "random",
        TYPES,
        objects=dict.fromkeys(OBJECTS, "thing"),
        predicates=PREDICATES,
        operators=made,
        deductive_operators=draw(deductive_operators()) if deductive else (),
        rules=draw(rules()),
    )
    everything = [Function(n, (c,)) for n in ("p", "q") for c in CONSTANTS] + [Function("r")]
    initial = tuple(atom for atom in everything if draw(st.booleans()))
    return Problem(
        "random", domain, initial=initial, goal=draw(conditions(CONSTANTS)), complete=True
    )


def successors(
    semantics: Semantics, problem: Problem, state: State
) -> Iterator[tuple[Function, State]]:
    """Every applicable operator instance with the state that follows."""
    facts = semantics.facts(state)
    for operator in problem.domain.operators:
        for values in itertools.product(CONSTANTS, repeat=len(operator.parameters)):
            bindings = dict(zip(operator.variables, values, strict=True))
            if condition_holds(operator.precondition, facts, bindings):
                change = semantics.change(operator, bindings, facts, state)
                yield Function(operator.name, values), (state - change.ends) | change.adds


def shortest(problem: Problem) -> int | None:
    """The length of a shortest plan by breadth-first search over states; None if there is none."""
    semantics = Semantics(problem)
    start = semantics.initial()
    depth = {start: 0}
    queue = deque([start])
    while queue:
        state = queue.popleft()
        if problem.goal == ALWAYS_TRUE or condition_holds(problem.goal, semantics.facts(state), {}):
            return depth[state]
        for _, following in successors(semantics, problem, state):
            if following not in depth:
                depth[following] = depth[state] + 1
                queue.append(following)
    return None
