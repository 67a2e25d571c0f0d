"""Derived predicates of PDDL that read numbers, against brute force over their definition.

A random task is a nest of tuples. It is written as PDDL, and it is evaluated here: states are
searched one by one, and derived predicates are least fixpoints, one after the other.
"""

from collections.abc import Iterator, Mapping
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest
from hypothesis import HealthCheck, event, given, settings
from hypothesis import strategies as st

from cellwright.engine.formats.interop.pddl import PddlProblem, read_pddl_task
from cellwright.engine.formats.interop.pddl.competition_plans import read_plan, write_plan
from cellwright.engine.model.outcome import Found, Infeasible
from cellwright.engine.pipelines.planning import checked_plan
from cellwright.engine.stages.planning import SearchLimits
from cellwright.engine.stages.validation import validate_plan
from tests.properties.test_derived_atoms import layered

OBJECTS = ("a", "b")
VARIABLES = ("?x", "?y")
DERIVED = ("d0", "d1", "d2")
HIGHEST = 2
Formula = tuple[Any, ...]
Names = Mapping[str, str]
RELATED = {
    "<": lambda one, other: one < other,
    "<=": lambda one, other: one <= other,
    ">": lambda one, other: one > other,
    ">=": lambda one, other: one >= other,
    "=": lambda one, other: one == other,
}


@dataclass(frozen=True)
class State:
    """What is true, and what numbers are."""

    on: frozenset[str]
    done: bool
    numbers: tuple[int, ...]  # (t), (u a), (u b)


@dataclass(frozen=True)
class RandomTask:
    """A task with derived predicates of one variable, each of which may read itself and those
    before it.
    """

    rules: tuple[Formula, ...]
    preconditions: Mapping[str, Formula]
    goal: Formula
    caps: tuple[int, ...]
    start: State


def number_terms() -> st.SearchStrategy[Formula]:
    """A function applied to a variable, or a constant."""
    return st.sampled_from([("t",), ("u", "?x"), ("u", "?y"), ("cap", "?x"), (0,), (1,), (2,)])


def formulas(variables: tuple[str, ...], reads: tuple[str, ...], positive: str = "") -> Any:
    """Conditions over some variables; `positive` is a predicate that must not be negated."""
    names = st.sampled_from([*variables, *OBJECTS])
    bound = variables or ("a",)
    sums = number_terms().map(
        lambda term: tuple(bound[0] if each in VARIABLES else each for each in term)
    )
    plain: list[Any] = [
        st.tuples(st.just("on"), names),
        st.just(("done",)),
        st.tuples(st.sampled_from(sorted(RELATED)), sums, sums),
        *(st.tuples(st.just(read), names) for read in reads),
    ]
    if variables == ("?x", "?y"):
        plain.append(
            st.tuples(st.sampled_from([">", "="]), st.just(("u", "?x")), st.just(("u", "?y")))
        )
    atoms = st.one_of(plain)
    literals = st.one_of(
        [
            atoms,
            st.tuples(st.just("not"), atoms),
            *([st.tuples(st.just(positive), names)] * 2 if positive else []),
        ]
    )
    made = st.recursive(
        literals,
        lambda inner: st.tuples(st.sampled_from(["and", "or"]), inner, inner),
        max_leaves=4,
    )
    if variables == ("?x", "?y"):
        return made
    more = "?y" if variables else "?x"
    inner = formulas((*variables, more), reads, positive)
    universal = formulas((*variables, more), reads) if positive else inner
    quantified = st.one_of(
        st.tuples(st.just("exists"), st.just(more), inner),
        st.tuples(st.just("forall"), st.just(more), universal),
    )
    negated = st.tuples(st.just("not"), st.tuples(st.just("and"), literals, quantified))
    return st.one_of(made, quantified, made if positive else negated)


@st.composite
def tasks(draw: st.DrawFn) -> RandomTask:
    """A random task."""
    rules = tuple(
        draw(formulas(("?x",), DERIVED[:place], DERIVED[place] if draw(st.booleans()) else ""))
        for place in range(len(DERIVED))
    )
    preconditions = {
        "up": draw(formulas((), DERIVED)),
        "raise": draw(formulas(("?x",), DERIVED)),
        "turn": draw(formulas(("?x",), DERIVED)),
        "fin": draw(formulas((), DERIVED)),
    }
    numbers = st.integers(0, HIGHEST)
    start = State(
        frozenset(draw(st.sets(st.sampled_from(OBJECTS)))),
        False,
        (draw(numbers), draw(numbers), draw(numbers)),
    )
    goal = draw(st.one_of(st.just(("done",)), formulas((), DERIVED)))
    return RandomTask(rules, preconditions, goal, (draw(numbers), draw(numbers)), start)


def text_of(formula: Formula) -> str:
    """A condition in PDDL."""
    head, *rest = formula
    if head in ("exists", "forall"):
        return f"({head} ({rest[0]} - item) {text_of(rest[1])})"
    if len(formula) == 1 and isinstance(head, int):
        return str(head)
    return f"({' '.join([str(head), *(text_of(each) if isinstance(each, tuple) else each for each in rest)])})"


def written(task: RandomTask, folder: Path) -> PddlProblem:
    """The task, read from its two files."""
    needs = {name: text_of(each) for name, each in task.preconditions.items()}
    rules = "\n".join(
        f"(:derived ({name} ?x - item) {text_of(rule)})"
        for name, rule in zip(DERIVED, task.rules, strict=True)
    )
    (folder / "domain.pddl").write_text(f"""(define (domain d) (:types item)
 (:constants a b - item)
 (:predicates (on ?x - item) (done) (d0 ?x - item) (d1 ?x - item) (d2 ?x - item))
 (:functions (t) (u ?x - item) (cap ?x - item))
 {rules}
 (:action up :parameters () :precondition (and (< (t) {HIGHEST}) {needs["up"]}) :effect (increase (t) 1))
 (:action reset :parameters () :effect (assign (t) 0))
 (:action raise :parameters (?x - item) :precondition {needs["raise"]} :effect (assign (u ?x) (t)))
 (:action turn :parameters (?x - item) :precondition {needs["turn"]}
  :effect (and (when (on ?x) (not (on ?x))) (when (not (on ?x)) (on ?x))))
 (:action fin :parameters () :precondition {needs["fin"]} :effect (done)))""")
    t, *u = task.start.numbers
    values = [f"(= (t) {t})"]
    for place, name in enumerate(OBJECTS):
        values += [f"(= (u {name}) {u[place]})", f"(= (cap {name}) {task.caps[place]})"]
    facts = [f"(on {name})" for name in sorted(task.start.on)]
    (folder / "problem.pddl").write_text(
        f"(define (problem p) (:domain d) (:init {' '.join(values + facts)}) (:goal "
        f"{text_of(task.goal)}))"
    )
    return read_pddl_task(folder / "domain.pddl", folder / "problem.pddl")


class World:
    """What conditions mean in one state."""

    def __init__(self, task: RandomTask, state: State) -> None:
        self.task, self.state = task, state
        self.true: dict[str, set[str]] = {}
        for name, rule in zip(DERIVED, task.rules, strict=True):
            own = self.true[name] = set[str]()
            while True:
                more = {each for each in OBJECTS if self.holds(rule, {"?x": each})}
                if more <= own:
                    break
                own |= more

    def value(self, term: Formula, names: Names) -> int:
        """The value of a number term."""
        if term[0] == "t":
            return self.state.numbers[0]
        if term[0] in ("u", "cap"):
            place = OBJECTS.index(names.get(term[1], term[1]))
            return self.state.numbers[1 + place] if term[0] == "u" else self.task.caps[place]
        return int(term[0])

    def holds(self, formula: Formula, names: Names) -> bool:
        """Whether a condition holds."""
        match formula:
            case ("and", *parts):
                return all(self.holds(each, names) for each in parts)
            case ("or", *parts):
                return any(self.holds(each, names) for each in parts)
            case ("not", part):
                return not self.holds(part, names)
            case ("exists" | "forall" as quantifier, variable, part):
                found = [self.holds(part, {**names, variable: each}) for each in OBJECTS]
                return any(found) if quantifier == "exists" else all(found)
            case _:
                return self.is_true(formula, names)

    def is_true(self, formula: Formula, names: Names) -> bool:
        """Whether an atom or a comparison holds."""
        match formula:
            case ("on", name):
                return names.get(name, name) in self.state.on
            case ("done",):
                return self.state.done
            case (relation, one, other) if relation in RELATED:
                return RELATED[relation](self.value(one, names), self.value(other, names))
            case (derived, name):
                return names.get(name, name) in self.true[derived]
        raise AssertionError(formula)


def successors(task: RandomTask, state: State) -> Iterator[tuple[str, State]]:
    """The steps that are possible in a state, and where they lead."""
    world, (t, *u) = World(task, state), state.numbers
    needs = task.preconditions
    if t < HIGHEST and world.holds(needs["up"], {}):
        yield "(up)", State(state.on, state.done, (t + 1, *u))
    yield "(reset)", State(state.on, state.done, (0, *u))
    for place, name in enumerate(OBJECTS):
        if world.holds(needs["raise"], {"?x": name}):
            after = [*u[:place], t, *u[place + 1 :]]
            yield f"(raise {name})", State(state.on, state.done, (t, *after))
        if world.holds(needs["turn"], {"?x": name}):
            yield f"(turn {name})", State(state.on ^ {name}, state.done, state.numbers)
    if world.holds(needs["fin"], {}):
        yield "(fin)", State(state.on, True, state.numbers)


def solvable(task: RandomTask) -> bool:
    """Whether some sequence of steps leads to the goal."""
    seen, waiting = {task.start}, [task.start]
    while waiting:
        state = waiting.pop()
        if World(task, state).holds(task.goal, {}):
            return True
        for _, after in successors(task, state):
            if after not in seen:
                seen.add(after)
                waiting.append(after)
    return False


def is_plan(task: RandomTask, steps: list[str]) -> bool:
    """Whether steps can be taken one after the other and reach the goal."""
    state = task.start
    for step in steps:
        after = dict(successors(task, state)).get(step)
        if after is None:
            return False
        state = after
    return World(task, state).holds(task.goal, {})


FEW = settings(max_examples=4, deadline=None, suppress_health_check=list(HealthCheck))
MANY = settings(max_examples=150, deadline=None, suppress_health_check=list(HealthCheck))
STEPS = st.lists(
    st.sampled_from(["(up)", "(reset)", "(raise a)", "(raise b)", "(turn a)", "(turn b)", "(fin)"]),
    max_size=5,
)


def agree(task: RandomTask, steps: list[str], unfold: bool) -> None:
    """The planner finds a plan where there is one, and the checker accepts what is one."""
    with TemporaryDirectory() as name, nullcontext() if unfold else layered():
        problem = written(task, Path(name))
        outcome = checked_plan.plan_problem(
            problem.problem, SearchLimits(expansions=20_000, room=None)
        )
        event(type(outcome).__name__)
        if isinstance(outcome, Found):
            lines = write_plan(problem, outcome.plan).splitlines()
            assert is_plan(task, [line for line in lines if line.startswith("(")])
        else:
            assert isinstance(outcome, Infeasible)
            assert not solvable(task)
        (Path(name) / "plan").write_text("\n".join(steps))
        accepted = not validate_plan(problem.problem, read_plan(problem, Path(name) / "plan"))
        event(f"accepted: {accepted}")
        assert accepted == is_plan(task, steps)


@given(tasks(), STEPS, st.booleans())
@FEW
def test_planner_and_checker_agree_with_brute_force(
    task: RandomTask, steps: list[str], unfold: bool
) -> None:
    agree(task, steps, unfold)


@pytest.mark.slow
@given(tasks(), STEPS, st.booleans())
@MANY
def test_planner_and_checker_agree_with_brute_force_at_length(
    task: RandomTask, steps: list[str], unfold: bool
) -> None:
    agree(task, steps, unfold)
