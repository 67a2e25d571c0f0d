"""PDDL as its definition means it: types, scopes, numbers without values, keywords, costs.

What is not read is refused.
"""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from cellwright.engine.faces.cli import app
from cellwright.engine.formats.interop.pddl import PddlProblem, read_pddl_task
from cellwright.engine.formats.interop.pddl.competition_plans import read_plan, write_plan
from cellwright.engine.model.outcome import Found, Infeasible
from cellwright.engine.pipelines.planning import checked_plan
from cellwright.kb.diagnostics import InvalidInput


def files(folder: Path, domain: str, problem: str) -> tuple[Path, Path]:
    made = folder / "domain.pddl", folder / "problem.pddl"
    made[0].write_text(f"(define (domain d) {domain})")
    made[1].write_text(f"(define (problem p) (:domain d) {problem})")
    return made


def task(folder: Path, domain: str, problem: str) -> PddlProblem:
    return read_pddl_task(*files(folder, domain, problem))


def planned(folder: Path, domain: str, problem: str) -> list[str]:
    """The actions of the plan, which the checker accepts in the form of the competitions, too;
    `none` if there is none.
    """
    read = task(folder, domain, problem)
    outcome = checked_plan.plan_problem(read.problem)
    if isinstance(outcome, Infeasible):
        return ["none"]
    assert isinstance(outcome, Found)
    written = write_plan(read, outcome.plan)
    assert valid(folder, read, written)
    return [line.strip("()") for line in written.splitlines()[:-1]]


def valid(folder: Path, read: PddlProblem, actions: str) -> bool:
    (folder / "plan").write_text(actions)
    return not checked_plan.check_plan(read.problem, read_plan(read, folder / "plan"))


def refused(folder: Path, domain: str, problem: str) -> list[str]:
    with pytest.raises(InvalidInput) as error:
        task(folder, domain, problem)
    return [f"{each.code} {each.message} {each.hint}" for each in error.value.diagnostics]


TOOLS = """(:predicates (held ?t) (done))
  (:action hold :parameters (?t) :effect (held ?t))
  (:action end :parameters () :precondition (forall (?t - sharp) (held ?t)) :effect (done))"""


@pytest.mark.parametrize(
    "types",
    [
        "sharp heavy - object saw - sharp saw - heavy",
        "saw - heavy saw - sharp heavy - sharp",
        "saw - (either heavy sharp)",
        "blade - sharp saw - heavy saw - blade",
        "saw -sharp",
    ],
)
def test_all_parents_of_a_type_count(tmp_path: Path, types: str) -> None:
    problem = "(:objects s - saw) (:init) (:goal (done))"
    assert planned(tmp_path, f"(:types {types}) {TOOLS}", problem) == ["hold s", "end"]
    assert not valid(tmp_path, task(tmp_path, f"(:types {types}) {TOOLS}", problem), "(end)")


@pytest.mark.parametrize("constants", ["", "(:constants s - heavy)"])
def test_an_object_declared_under_two_types_is_of_both(tmp_path: Path, constants: str) -> None:
    domain = f"(:types sharp heavy) {constants} {TOOLS}"
    problem = "(:objects s - heavy s - sharp) (:init) (:goal (done))"
    assert planned(tmp_path, domain, problem) == ["hold s", "end"]


def test_a_type_below_itself_is_refused(tmp_path: Path) -> None:
    for types in ("a - b b - c c - d a - d c - a", "a - a", "object - a"):
        (said, *_) = refused(tmp_path, f"(:types {types}) (:predicates (p))", "(:init) (:goal (p))")
        assert said.startswith("K109")


def test_an_undecided_type_of_an_object_is_refused(tmp_path: Path) -> None:
    (said,) = refused(
        tmp_path,
        "(:types a b) (:predicates (p))",
        "(:objects o - (either a b)) (:init) (:goal (p))",
    )
    assert said.startswith("K802 an object of an undecided type")


def test_some_object_of_a_type_without_objects_does_nothing(tmp_path: Path) -> None:
    domain = (
        "(:types a) (:predicates (p) (q)) (:action go :precondition (exists (?x - a) (p)) "
        ":effect (q))"
    )
    read = task(tmp_path, domain, "(:init (p)) (:goal (q))")
    assert isinstance(checked_plan.plan_problem(read.problem), Infeasible)
    assert not valid(tmp_path, read, "(go)")


SCOPES = {
    "exists": "(:action go :parameters (?x) :precondition (and (p ?x) (exists (?x) (q ?x))) "
    ":effect "
    "(done))",
    "forall": "(:action go :parameters (?x) :precondition (and (p ?x) (forall (?x) (or (p ?x) (q "
    "?x)))) :effect (done))",
    "nested": """(:action go :parameters (?x) :precondition (and (p ?x)
        (exists (?x) (and (q ?x) (forall (?x) (or (p ?x) (q ?x))) (not (p ?x))))) :effect (done))""",
    "effect": """(:action go :parameters (?x) :precondition (p ?x)
        :effect (forall (?x) (when (q ?x) (and (done) (forall (?x) (q ?x))))))""",
    "when": "(:action go :parameters (?x) :precondition (p ?x) :effect (when (exists (?x) (q ?x)) "
    "(done)))",
    "derived": """(:derived (ready ?x) (and (p ?x) (exists (?x) (q ?x))))
        (:action go :parameters (?x) :precondition (ready ?x) :effect (done))""",
}


@pytest.mark.parametrize("name", SCOPES)
def test_a_quantified_variable_hides_a_parameter(tmp_path: Path, name: str) -> None:
    domain = f"(:predicates (p ?x) (q ?x) (ready ?x) (done)) {SCOPES[name]}"
    domain = domain if name == "derived" else domain.replace(" (ready ?x)", "")
    problem = (
        "(:objects a b) (:init (p a) (q b)) (:goal (and (done) (exists (?x) (and (p ?x) (exists "
        "(?x) (q ?x))))))"
    )
    assert planned(tmp_path, domain, problem) == ["go a"]


FLASK = """(:types flask) (:predicates (done) (ok)) (:functions (level ?f - flask) (free) (spare))
  (:action fill :parameters (?f - flask) :effect (assign (level ?f) 1.6e3))
  (:action drain :parameters (?f - flask) :effect (decrease (level ?f) 600))
  (:action end :parameters (?f - flask) :precondition CONDITION :effect (done))"""
START = "(:objects f - flask) (:init (= (free) 1)) (:goal (done))"


@pytest.mark.parametrize(
    ("condition", "plan"),
    [
        ("(>= (level ?f) 0)", ["fill f", "end f"]),
        ("(not (>= (level ?f) 2e3))", ["fill f", "end f"]),
        ("(= (level ?f) (level ?f))", ["fill f", "end f"]),
        ("(= (level ?f) 1000)", ["fill f", "drain f", "end f"]),
        ("(imply (< (level ?f) 5) (ok))", ["fill f", "end f"]),
        ("(or (not (ok)) (> (level ?f) 5))", ["end f"]),
        ("(forall (?g - flask) (> (level ?g) 5))", ["fill f", "end f"]),
        ("(> (spare) 0)", ["none"]),
        ("(not (> (spare) 0))", ["none"]),
        ("(or (> (spare) 0) (> (free) 0))", ["end f"]),
        ("(> (- (spare) (spare)) -1)", ["none"]),
    ],
)
def test_a_condition_on_a_number_without_value_is_not_satisfied(
    tmp_path: Path, condition: str, plan: list[str]
) -> None:
    assert planned(tmp_path, FLASK.replace("CONDITION", condition), START) == plan


def test_an_effect_that_reads_a_number_without_value_is_not_applicable(tmp_path: Path) -> None:
    read = task(tmp_path, FLASK.replace("CONDITION", "(< (level ?f) 5000)"), START)
    assert not valid(tmp_path, read, "(drain f)\n(fill f)\n(end f)\n")
    assert valid(tmp_path, read, "(fill f)\n(drain f)\n(end f)\n")


def test_a_value_of_a_function_that_is_not_declared_is_told_and_passed_over(tmp_path: Path) -> None:
    start = START.replace("(= (free) 1)", "(= (free) 1) (= (fre) 7.0)")
    read = task(tmp_path, FLASK.replace("CONDITION", "(> (free) 0)"), start)
    (warning,) = read.warnings
    assert (warning.code, warning.warning, warning.hint) == ("K101", True, "did you mean 'free'?")
    assert isinstance(checked_plan.plan_problem(read.problem), Found)


def test_two_values_of_one_function_are_refused(tmp_path: Path) -> None:
    start = START.replace("(= (free) 1)", "(= (free) 1) (= (free) 2)")
    (said,) = refused(tmp_path, FLASK.replace("CONDITION", "(> (free) 0)"), start)
    assert said.startswith("K115 free has two values")


BINS = """(:types bin) (:predicates (moved ?b - bin)) (:functions (n ?b - bin))
  (:action shift :parameters (?a ?b - bin) :precondition (>= (n ?a) 1)
    :effect (and (decrease (n ?a) 1) (increase (n ?b) 3) (moved ?b)))
  (:action put :parameters (?a ?b - bin) :effect (and (assign (n ?a) 5) (decrease (n ?b) 1) (moved ?b)))"""


def test_changes_of_one_number_add_up(tmp_path: Path) -> None:
    problem = "(:objects a - bin) (:init (= (n a) 1)) (:goal (and (moved a) (= (n a) 3)))"
    assert planned(tmp_path, BINS, problem) == ["shift a a"]
    two = task(
        tmp_path,
        BINS,
        problem.replace("(:objects a", "(:objects a b").replace(
            "(= (n a) 1)", "(= (n a) 1) (= (n b) 0)"
        ),
    )
    assert valid(tmp_path, two, "(shift a b)\n(shift b a)\n")
    assert not valid(tmp_path, two, "(shift a b)\n(shift b b)\n")


def test_a_number_that_is_assigned_bears_no_other_change(tmp_path: Path) -> None:
    problem = "(:objects a b - bin) (:init (= (n a) 1) (= (n b) 1)) (:goal (moved a))"
    read = task(tmp_path, BINS, problem)
    assert valid(tmp_path, read, "(put b a)")
    assert not valid(tmp_path, read, "(put a a)")


def test_a_predicate_and_a_function_may_have_one_name(tmp_path: Path) -> None:
    domain = """(:predicates (stock ?x) (done)) (:functions (stock ?x))
      (:action take :parameters (?x) :precondition (and (stock ?x) (> (stock ?x) 0)) :effect (decrease (stock ?x) 1))
      (:action end :parameters (?x) :precondition (= (stock ?x) 0) :effect (done))"""
    problem = "(:objects a) (:init (stock a) (= (stock a) 1)) (:goal (done))"
    assert planned(tmp_path, domain, problem) == ["take a", "end a"]


PLAIN = (
    "(:predicates (p ?x) (q ?x)) (:action go :parameters (?x) :precondition (p ?x) :effect (q ?x))"
)
GOAL = "(:objects a) (:init (p a)) (:goal (q a))"


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (
            ":precondition",
            ":precondtion",
            "K801 ':precondtion' is no field of an action did you mean ':precondition'?",
        ),
        ("(:action", "(:acton", "K802 :acton is not supported did you mean ':action'?"),
        (":effect (q ?x)", ":effect (q ?x) :effect (p ?x)", "K104 :effect stands here twice"),
        (":effect (q ?x)", ":effect", "K801 nothing is said after :effect"),
        (
            ":effect (q ?x)",
            ":effect ((q ?x) (p ?x))",
            "K801 a name is missing after this parenthesis",
        ),
        ("(?x) :pre", "(?x ?x) :pre", "K104 variable ?x is declared twice"),
        (
            "(:predicates",
            "(:functions (place ?x) - object) (:predicates",
            "K802 object fluents are not supported",
        ),
        (
            "(:predicates",
            "(:functions - number) (:predicates",
            "K801 '-' stands between functions and their type",
        ),
        ("(:predicates", "(:types - thing) (:predicates", "K801 no name stands before this '-'"),
        ("(:predicates", "(:requirements :typin) (:predicates", "K801 ':typin' is no requirement"),
        (
            "(:predicates",
            "(:derived (q ?x) (p ?x)) (:predicates",
            "K103 'q' is derived: no effect can change it",
        ),
        (
            "(:init",
            "(:init (= (place a) a)",
            "K802 this initial value is not supported object fluents are not read",
        ),
        ("(:action", "(:action go :effect (p ?x)) (:action", "K104 action 'go' is declared twice"),
        ("(:init", "(:init p", "K801 'p' is not a fact"),
        ("(:goal", "(:init) (:goal", "K104 :init stands here twice"),
        (
            "(:init",
            "(:init (oneof (p a) (q a))",
            "K802 facts and effects with 'oneof' are not supported",
        ),
        (
            ":effect (q ?x)",
            ":effect (probabilistic 0.5 (q ?x))",
            "K802 facts and effects with 'probabilistic' are not supported",
        ),
    ],
)
def test_what_is_misspelt_or_not_read_is_told(
    tmp_path: Path, old: str, new: str, said: str
) -> None:
    assert (old in PLAIN) != (old in GOAL)
    assert any(
        each.startswith(said)
        for each in refused(tmp_path, PLAIN.replace(old, new), GOAL.replace(old, new))
    )


@pytest.mark.parametrize("number", [0, 1])
def test_a_file_begins_with_define(tmp_path: Path, number: int) -> None:
    both = files(tmp_path, PLAIN, GOAL)
    both[number].write_text(both[number].read_text().replace("(define", "(defie"))
    with pytest.raises(InvalidInput, match="'defie' begins no PDDL file"):
        read_pddl_task(*both)


@pytest.mark.parametrize(
    ("amount", "cost"),
    [("0.5", "0.5"), ("(/ 1 8)", "0.125"), ("2.50", "2.5"), ("1e-6", "0.000001"), ("3", "3")],
)
def test_every_output_tells_the_cost_of_the_task(tmp_path: Path, amount: str, cost: str) -> None:
    domain = (
        "(:predicates (g)) (:functions (total-cost)) (:action a :effect (and (g) (increase "
        f"(total-cost) {amount})))"
    )
    both = [
        *map(str, files(tmp_path, domain, "(:init) (:goal (g)) (:metric minimize (total-cost))"))
    ]
    (tmp_path / "plan").write_text("(a)\n")

    def shown(*words: str) -> str:
        return CliRunner().invoke(app, [words[0], "--pddl", *both, *words[1:]]).output

    assert f"cost {cost}\n" in shown("plan")
    assert f"; cost = {cost}\n" in shown("plan", "--format", "ipc")
    assert f"costs {cost}<" in shown("plan", "--format", "svg")
    assert f"cost {cost}," in shown("validate", str(tmp_path / "plan"))
    text = shown("plan", "--format", "json")
    plan = json.loads(text, parse_float=str, parse_int=str)["data"]["plan"]
    assert plan["cost"] == plan["steps"][0]["cost"] == cost


def test_a_cost_that_is_no_decimal_is_a_fraction(tmp_path: Path) -> None:
    domain = (
        "(:predicates (g)) (:functions (total-cost)) (:action a :effect (and (g) (increase "
        "(total-cost) (/ 1 3))))"
    )
    read = task(tmp_path, domain, "(:init) (:goal (g)) (:metric minimize (total-cost))")
    outcome = checked_plan.plan_problem(read.problem)
    assert isinstance(outcome, Found)
    assert write_plan(read, outcome.plan).endswith("; cost = 1/3\n")


@pytest.mark.parametrize(
    ("metric", "cost"),
    [
        ("(+ (used a) (used b))", 2),
        ("(* 3 (+ (used b) (used a)))", 6),
        ("(used b)", None),
        ("(+ (* 2 (used a)) (used b))", None),
    ],
)
def test_a_metric_counts_a_function_for_all_objects_alike_or_is_not_followed(
    tmp_path: Path, metric: str, cost: int | None
) -> None:
    domain = """(:predicates (g)) (:functions (used ?x))
      (:action a :parameters (?x) :effect (and (g) (increase (used ?x) 2)))"""
    start = "(:objects a b) (:init (= (used a) 0) (= (used b) 0)) (:goal (g))"
    read = task(tmp_path, domain, f"{start} (:metric minimize {metric})")
    outcome = checked_plan.plan_problem(read.problem)
    assert isinstance(outcome, Found)
    assert outcome.plan.cost == (1 if cost is None else cost)
    assert [each.message for each in read.warnings] == (
        ["the metric is not followed: used counts for some objects only"] if cost is None else []
    )
