"""A problem and its export have the same plans."""

import itertools
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hypothesis import HealthCheck, event, given, settings
from hypothesis import strategies as st

from cellwright.engine.formats.interop.pddl import PddlProblem, read_pddl_task
from cellwright.engine.formats.interop.pddl.competition_plans import read_plan
from cellwright.engine.formats.interop.pddl.competition_plans import write_plan as write_pddl_plan
from cellwright.engine.formats.interop.pddl.export import PddlText, import_plan, pddl_text_of
from cellwright.engine.formats.interop.pddl.expressions import plan_actions
from cellwright.engine.model.outcome import Found, Infeasible
from cellwright.engine.pipelines.planning import checked_plan
from cellwright.engine.stages.grounding import ground
from cellwright.engine.stages.planning import SearchLimits
from cellwright.engine.stages.validation import validate_plan
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.loader import find_target, problem_files
from cellwright.kb.model.conditions import ALWAYS_TRUE, Literal, Parameter
from cellwright.kb.model.domain_model import (
    Consequence,
    DeductiveOperator,
    Domain,
    Effect,
    Kind,
    Operator,
    Predicate,
)
from cellwright.kb.model.planning_problem import Chain, Problem
from cellwright.kb.terms import ANYTHING, Function
from tests.engine.formats.interop.test_pddl import task
from tests.places import DOMAINS as TESTED
from tests.properties.problems import CONSTANTS, PREDICATES, TYPES, X, Y, problems, shortest
from tests.properties.test_quantities import cases, loaded

BUNDLED = [file for name in ("bulkhead", "themse") for file in problem_files(find_target(name))]
PANTRY = Path(__file__).parent / "pantry"
SMALL = {"one_point", "tool_missing", "one"}  # of the cells without quantities
LONG = {"never", "eight", *(file.stem for file in BUNDLED if file.stem not in SMALL)}
FIRST = SearchLimits(room=None, restarts=0, improvement=0)  # any plan will do
TARGETS = [
    pytest.param(file, marks=[pytest.mark.slow] if file.stem in LONG else [])
    for file in (
        *BUNDLED,
        *problem_files(find_target("centrifuge")),
        *sorted(TESTED.glob("*/problems/*.yaml")),
        *sorted(PANTRY.glob("problems/*.yaml")),
    )
]


def reread(text: PddlText, folder: Path) -> PddlProblem:
    """What our own reader makes of an export."""
    (folder / "domain.pddl").write_text(text.domain)
    (folder / "problem.pddl").write_text(text.problem)
    return read_pddl_task(folder / "domain.pddl", folder / "problem.pddl")


@pytest.mark.parametrize(
    "lifted", [True, pytest.param(False, marks=pytest.mark.slow)], ids=["lifted", "ground"]
)
@pytest.mark.parametrize("file", TARGETS, ids=lambda file: f"{file.parents[1].name}-{file.stem}")
def test_an_export_has_the_plans_of_its_problem(file: Path, lifted: bool, tmp_path: Path) -> None:
    problem = checked_plan.problem_of(str(file))
    text = pddl_text_of(problem, ground(problem), lifted)
    read = reread(text, tmp_path)
    own, theirs = (
        checked_plan.plan_problem(problem, FIRST),
        checked_plan.plan_problem(read.problem, FIRST),
    )
    assert isinstance(own, Infeasible) == isinstance(theirs, Infeasible)
    if isinstance(own, Found):
        assert isinstance(theirs, Found)
        imported = import_plan(text, write_pddl_plan(read, theirs.plan))
        assert checked_plan.check_plan(problem, imported) == []
        (tmp_path / "plan").write_text(text.plans.written(own.plan))
        assert checked_plan.check_plan(read.problem, read_plan(read, tmp_path / "plan")) == []


@pytest.mark.parametrize("file", TARGETS[: len(BUNDLED)], ids=lambda file: file.stem)
def test_both_cells_are_exported_lifted(file: Path) -> None:
    problem = checked_plan.problem_of(str(file))
    text = pddl_text_of(problem, ground(problem))
    assert (text.lifted, text.why_ground) == (True, "")


def test_what_is_read_of_pddl_can_be_written_again(tmp_path: Path) -> None:
    first = task(tmp_path)
    text = pddl_text_of(first.problem, ground(first.problem))
    assert (text.lifted, text.why_ground) == (True, "")
    again = reread(text, tmp_path)
    own, theirs = checked_plan.plan_problem(first.problem), checked_plan.plan_problem(again.problem)
    assert isinstance(own, Found)
    assert isinstance(theirs, Found)
    assert own.plan.cost == theirs.plan.cost
    assert (
        checked_plan.check_plan(
            first.problem, import_plan(text, write_pddl_plan(again, theirs.plan))
        )
        == []
    )


def test_every_way_of_the_language_has_one_in_pddl() -> None:
    problem = checked_plan.problem_of(str(PANTRY / "problems" / "everything.yaml"))
    domain = pddl_text_of(problem, ground(problem)).domain
    table = "(where_put ?jar ?from ?to ?w)"  # arithmetic in a constraint
    relation = "(is_lid ?jar ?lid)"  # a compound term with a variable
    unfolded = "(not (open ?jar))"  # a derived predicate
    axiom = "(:derived (linked ?x - place ?x-2 - place)"  # a recursive one
    deduced = "(forall (?m - numeral) (not (filled ?jar ?m)))"
    cost = "(increase (total-cost) (cost_put ?w))"
    for said in (table, relation, unfolded, axiom, deduced, cost):
        assert said in domain


def test_deduction_that_leads_back_to_itself_is_exported_ground() -> None:
    problem = checked_plan.problem_of(str(TESTED / "blocks" / "problems" / "sussman.yaml"))
    trigger, consequence = Function("on", (X, Y)), Function("on", (Y, X))
    parameters = tuple(Parameter(each, "block") for each in (X, Y))
    back = DeductiveOperator(
        Literal(trigger, False), parameters, (), (Consequence(consequence, False, (), parameters),)
    )
    domain = replace(
        problem.domain, deductive_operators=(*problem.domain.deductive_operators, back)
    )
    text = pddl_text_of(replace(problem, domain=domain), ground(problem))
    assert not text.lifted
    assert "leads back to itself" in text.why_ground


def _agrees(problem: Problem, lifted: bool, folder: Path) -> None:
    """The export of a random problem has a plan if brute force finds one, and it is one for the
    problem.
    """
    try:
        text = pddl_text_of(problem, ground(problem), lifted)
    except InvalidInput:  # contradictions and ambiguities have no export
        return
    event("lifted" if text.lifted else f"ground: {text.why_ground.split(' for ')[0]}")
    read = reread(text, folder)
    found = checked_plan.plan_problem(read.problem, SearchLimits(expansions=20_000))
    length = shortest(problem)
    assert isinstance(found, Found) == (length is not None)
    if isinstance(found, Found):
        assert validate_plan(problem, import_plan(text, write_pddl_plan(read, found.plan))) == []


@pytest.mark.parametrize("lifted", [True, False], ids=["lifted", "ground"])
@settings(
    deadline=None, max_examples=20, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(problem=problems(conditional=True))
def test_random_problems_are_exported(problem: Problem, lifted: bool, tmp_path: Path) -> None:
    _agrees(problem, lifted, tmp_path)


@pytest.mark.parametrize("lifted", [True, False], ids=["lifted", "ground"])
@settings(
    deadline=None, max_examples=20, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(problem=problems(deductive=True))
def test_deduction_is_compiled(problem: Problem, lifted: bool, tmp_path: Path) -> None:
    _agrees(problem, lifted, tmp_path)


DONE = Predicate("done", ("thing",), Kind.EVENT)
STAGES = [Function(name, (term,)) for name in ("p", "q", "done") for term in CONSTANTS]
STAGES += [Function("r"), Function("p", (ANYTHING,))]


@st.composite
def chained(draw: st.DrawFn) -> Problem:
    """A random problem with an event and up to two chains, of which one may wait for the other."""
    problem = draw(problems(conditional=draw(st.booleans()), deductive=draw(st.booleans())))
    first, *others = problem.domain.operators
    term = first.variables[0] if first.parameters else CONSTANTS[0]
    first = replace(first, effects=(*first.effects, Effect(Function("done", (term,)))))
    domain = replace(
        problem.domain,
        operators=(first, *others),
        predicates={**problem.domain.predicates, "done": DONE},
    )
    stages = st.lists(st.sampled_from(STAGES), min_size=1, max_size=2).map(tuple)
    chains = [Chain("one", draw(stages), (), draw(st.sampled_from([None, CONSTANTS[0]])))]
    if draw(st.booleans()):
        chains.append(
            Chain("other", draw(stages), ("one",) if draw(st.booleans()) else (), CONSTANTS[0])
        )
    return replace(problem, domain=domain, goal=ALWAYS_TRUE, chains=tuple(chains))


@pytest.mark.parametrize("lifted", [True, False], ids=["lifted", "ground"])
@settings(
    deadline=None, max_examples=20, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(problem=chained())
def test_workflows_are_compiled(problem: Problem, lifted: bool, tmp_path: Path) -> None:
    try:
        text = pddl_text_of(problem, ground(problem), lifted)
        own = checked_plan.plan_problem(problem)
    except InvalidInput:  # the domain contradicts itself, perhaps only where a plan leads
        return
    read = reread(text, tmp_path)
    theirs = checked_plan.plan_problem(read.problem)
    event(f"{type(own).__name__}, {'lifted' if text.lifted else text.why_ground.split(' for ')[0]}")
    assert isinstance(own, Found) == isinstance(theirs, Found)
    if isinstance(own, Found) and isinstance(theirs, Found):
        assert validate_plan(problem, import_plan(text, write_pddl_plan(read, theirs.plan))) == []
        (tmp_path / "plan").write_text(text.plans.written(own.plan))
        assert checked_plan.check_plan(read.problem, read_plan(read, tmp_path / "plan")) == []


def test_stages_that_can_be_reached_in_several_ways_are_planned() -> None:
    """Either of two steps may reach the last stage of `one`: the plan means another than the
    checker sees first.
    """
    a, b = (Function("p", (term,)) for term in CONSTANTS)
    done = Function("done", (CONSTANTS[0],))
    operators = (
        Operator("o0", (), ALWAYS_TRUE, (Effect(a), Effect(done))),
        Operator("o1", (), ALWAYS_TRUE, (Effect(a), Effect(b))),
    )
    objects = dict.fromkeys(map(str, CONSTANTS), "thing")
    domain = Domain(
        "ways", TYPES, objects=objects, predicates={**PREDICATES, "done": DONE}, operators=operators
    )
    chains = (Chain("one", (b, a)), Chain("other", (done, a), (), CONSTANTS[0]))
    assert isinstance(
        checked_plan.plan_problem(Problem("ways", domain, chains=chains, complete=True)), Found
    )


@pytest.mark.parametrize(
    "line", ["(lift a)", "lift a", "3.5: (lift a) [1]", "  (LIFT a) ; now", "( lift a );"]
)
def test_plans_are_read_as_planners_print_them(line: str) -> None:
    text = f"; cost = 3\n\n{line}\n"
    ((words, offset),) = plan_actions(text)
    assert words == ["lift", "a"]
    assert text[offset : offset + 4].lower() == "lift"


def test_a_line_that_is_no_action_is_refused() -> None:
    problem = checked_plan.problem_of(str(TESTED / "workshop" / "problems" / "dirty.yaml"))
    for lifted, line in itertools.product((True, False), ("(a) (b)", "((a))", "(a) b", "(a b)")):
        text = pddl_text_of(problem, ground(problem), lifted)
        assert import_plan(text, "(light_fire)\n(look)").steps
        with pytest.raises(InvalidInput):
            import_plan(text, line.replace("a", "light_fire").replace("b", "look"))


def test_what_is_no_action_of_the_export_is_pointed_at() -> None:
    problem = checked_plan.problem_of("bulkhead/one_point")
    text = pddl_text_of(problem, ground(problem))
    with pytest.raises(InvalidInput) as error:
        import_plan(
            text, "(mvoe t3_746)\n(move t3_746)\n(apply_couplant t3_746 m2 m9 m9 m9)\n", "sas_plan"
        )
    said = [str(each) for each in sorted(error.value.diagnostics, key=lambda each: each.where.line)]
    assert "sas_plan:1:2" in said[0]
    assert "did you mean 'move'?" in said[0]
    assert "sas_plan:2:2" in said[1]
    assert "arguments, not 1" in said[1]
    assert "sas_plan:3:2" in said[2]
    assert "unknown object 'm9'" in said[2]


@given(cases())
@settings(max_examples=5, deadline=None)
def test_quantities_are_written_as_numeric_fluents(case: tuple[str, str]) -> None:
    """Random jugs: the export has a plan if the problem has one, and plans of each are plans of
    the other.
    """
    with TemporaryDirectory() as folder:
        problem = loaded(*case, folder)
        text = pddl_text_of(problem, ground(problem))
        read = reread(text, Path(folder))
        own, theirs = (
            checked_plan.plan_problem(problem, FIRST),
            checked_plan.plan_problem(read.problem, FIRST),
        )
        assert type(own) is type(theirs)
        if isinstance(own, Found) and isinstance(theirs, Found):
            imported = import_plan(text, write_pddl_plan(read, theirs.plan))
            assert checked_plan.check_plan(problem, imported) == []
            (Path(folder) / "plan").write_text(text.plans.written(own.plan))
            assert (
                checked_plan.check_plan(read.problem, read_plan(read, Path(folder) / "plan")) == []
            )
