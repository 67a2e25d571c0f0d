import re
from pathlib import Path

import pytest

from cellwright.engine.formats.interop.pddl import PddlProblem, read_pddl_task
from cellwright.engine.formats.interop.pddl.competition_plans import read_plan, write_plan
from cellwright.engine.model.outcome import Found, Infeasible
from cellwright.engine.pipelines.planning import checked_plan
from cellwright.kb.diagnostics import InvalidInput

DOMAIN = """\
(define (domain delivery-robot)
  (:requirements :adl :derived-predicates :action-costs)
  (:types room - place dock - place robot crate - thing)
  (:constants base - dock)
  (:predicates (at ?t - thing ?p - place) (linked ?a ?b - place) (open ?a ?b - place) (in ?c - crate ?r - robot)
               (dusty ?p - (either room dock)) (reachable ?r - robot ?p - place) (marked ?t) (tidy))
  (:functions (total-cost) - number (distance ?a ?b - place) - number)
  (:derived (reachable ?r ?p) (or (at ?r ?p) (exists (?q - place) (and (reachable ?r ?q) (linked ?q ?p) (open ?q ?p)))))
  (:action Go :parameters (?r - robot ?from ?to - place)
     :precondition (and (at ?r ?from) (linked ?from ?to) (open ?from ?to) (not (= ?from ?to)))
     :effect (and (at ?r ?to) (not (at ?r ?from)) (when (dusty ?to) (marked ?r))
                  (increase (total-cost) (distance ?from ?to))))
  (:action unlock :parameters (?r - robot ?a ?b - place)
     :precondition (and (reachable ?r ?a) (linked ?a ?b)) :effect (and (open ?a ?b) (open ?b ?a)
                  (increase (total-cost) 1)))
  (:action load :parameters (?r - robot ?c - crate ?p - place)
     :precondition (and (at ?r ?p) (at ?c ?p) (imply (dusty ?p) (marked ?r)))
     :effect (and (in ?c ?r) (not (at ?c ?p)) (increase (total-cost) 1)))
  (:action drop-all :parameters (?r - robot ?p - place)
     :precondition (at ?r ?p)
     :effect (and (forall (?c - crate) (when (in ?c ?r) (and (at ?c ?p) (not (in ?c ?r))))) (increase (total-cost) 2)))
  (:action sweep :parameters (?r - robot ?p - place)
     :precondition (and (at ?r ?p) (dusty ?p)) :effect (and (not (dusty ?p)) (increase (total-cost) 1)))
  (:action report :parameters ()
     :precondition (forall (?p - place) (not (dusty ?p))) :effect (and (tidy) (increase (total-cost) 1))))
"""
PROBLEM = """\
(define (problem p-1) (:domain delivery-robot)
  (:objects r2-d2 - robot hall attic - room c1 c2 - crate)
  (:init (at r2-d2 base) (at c1 attic) (at c2 attic) (dusty hall) (linked base hall) (linked hall base)
         (linked hall attic) (linked attic hall) (= (total-cost) 0)
         (= (distance base hall) 3) (= (distance hall base) 3) (= (distance hall attic) 5) (= (distance attic hall) 5))
  (:goal (and (forall (?c - crate) (at ?c base)) (tidy) (or (marked r2-d2) (dusty base))))
  (:metric minimize (total-cost)))
"""


def task(folder: Path, domain: str = DOMAIN, problem: str = PROBLEM) -> PddlProblem:
    (folder / "domain.pddl").write_text(domain)
    (folder / "problem.pddl").write_text(problem)
    return read_pddl_task(folder / "domain.pddl", folder / "problem.pddl")


def test_every_classical_feature_is_planned_and_checked(tmp_path: Path) -> None:
    read = task(tmp_path)
    outcome = checked_plan.plan_problem(read.problem)
    assert isinstance(outcome, Found)
    written = write_plan(read, outcome.plan)
    assert "(go r2-d2 base hall)" in written
    assert "(drop-all r2-d2 base)" in written
    assert written.endswith("; cost = 24\n")


def test_a_written_plan_is_read_again(tmp_path: Path) -> None:
    read = task(tmp_path)
    outcome = checked_plan.plan_problem(read.problem)
    assert isinstance(outcome, Found)
    (tmp_path / "plan").write_text(write_plan(read, outcome.plan))
    again = read_plan(read, tmp_path / "plan")
    assert [step.operator for step in again.steps] == [step.operator for step in outcome.plan.steps]
    assert again.cost == outcome.plan.cost
    assert checked_plan.check_plan(read.problem, again) == []


@pytest.mark.parametrize("name", ["P", "E", "D", "A", "H", "B", "G", "X"])
def test_the_names_of_variables_mean_nothing(tmp_path: Path, name: str) -> None:
    plain = [str(each.instance) for each in checked_plan.ground(task(tmp_path).problem).operators]
    found = sorted(set(re.findall(r"\?[a-z]+", DOMAIN)))
    names = {variable: f"?{name}{number}" for number, variable in enumerate(found)}
    renamed = re.sub(r"\?[a-z]+", lambda variable: names[variable[0]], DOMAIN)
    assert [
        str(each.instance)
        for each in checked_plan.ground(task(tmp_path, renamed).problem).operators
    ] == plain


def test_a_plan_that_skips_a_precondition_is_refused(tmp_path: Path) -> None:
    read = task(tmp_path)
    (tmp_path / "plan").write_text("(go r2-d2 base hall)\n")
    (found, *_) = checked_plan.check_plan(read.problem, read_plan(read, tmp_path / "plan"))
    assert found.code == "K501"
    assert "open(base, hall)" in found.message


def test_names_that_asp_does_not_allow_are_kept_apart(tmp_path: Path) -> None:
    domain = (
        "(define (domain d) (:predicates (not-x) (not_x) (Object ?o)) (:action a :parameters "
        "(?o-1 ?o_1)"
    )
    domain += (
        " :precondition (and (object ?o-1) (not (object ?o_1))) :effect (and (not-x) (not "
        "(not_x)))))"
    )
    problem = "(define (problem p) (:domain d) (:objects 1a a-b a_b) (:init (object 1a) (not_x))"
    problem += " (:goal (and (not-x) (not (not_x)))))"
    read = task(tmp_path, domain, problem)
    outcome = checked_plan.plan_problem(read.problem)
    assert isinstance(outcome, Found)
    assert write_plan(read, outcome.plan).startswith("(a 1a a")


def test_what_cannot_be_done_is_proved(tmp_path: Path) -> None:
    read = task(tmp_path, problem=PROBLEM.replace("(linked base hall) ", ""))
    assert isinstance(checked_plan.plan_problem(read.problem), Infeasible)


WRONG = {
    "unknown predicate": ("(tidy) (or", "(tidyy) (or", "K101", "did you mean 'tidy'?"),
    "unknown object": ("(at r2-d2 base)", "(at r2-d3 base)", "K101", "did you mean 'r2-d2'?"),
    "arity": ("(dusty hall)", "(dusty hall attic)", "K102", "takes 1 argument"),
    "wrong type": ("(at c1 attic)", "(at attic c1)", "K103", "attic is room"),
    "no goal": ("(:goal", "(:gaol", "K802", ":gaol is not supported"),
    "unbalanced": (
        "(:metric minimize (total-cost)))",
        "(:metric minimize (total-cost))",
        "K106",
        "never closed",
    ),
    "too many": (
        "(:metric minimize (total-cost)))",
        "(:metric minimize (total-cost))))",
        "K106",
        "outside",
    ),
    "timed literal": ("(dusty hall)", "(at 5 (dusty hall))", "K802", "not supported"),
    "number": ("(= (total-cost) 0)", "(= (total-cost) 1e3x)", "K802", "whole or decimal"),
    "constraints": (
        "(:metric",
        "(:constraints (always (tidy))) (:metric",
        "K802",
        ":constraints is not supported",
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_what_is_wrong_with_a_problem_is_said_at_its_place(tmp_path: Path, name: str) -> None:
    old, new, code, said = WRONG[name]
    assert old in PROBLEM
    with pytest.raises(InvalidInput) as error:
        task(tmp_path, problem=PROBLEM.replace(old, new))
    found = [each for each in error.value.diagnostics if each.code == code]
    assert found
    assert said in str(found[0])
    assert found[0].where.line > 0 or "outside" in said


WRONG_DOMAINS = {
    "durative action": ("(:action report", "(:durative-action report", "K802"),
    "numeric condition": (
        "(at ?r ?p) (dusty ?p))",
        "(at ?r ?p) (> (/ 1 (distance ?p ?p)) 3))",
        "K802",
    ),
    "numeric effect": (
        "(not (dusty ?p)) (increase (total-cost) 1)",
        "(decrease 1 (total-cost))",
        "K801",
    ),
    "undeclared variable": ("(at ?r ?p) (dusty ?p)", "(at ?r ?p) (dusty ?q)", "K105"),
    "unknown type": ("?c - crate ?p - place", "?c - crat ?p - place", "K101"),
    "type cycle": ("room - place", "room - place place - room", "K109"),
    "twice": ("(tidy))", "(tidy) (tidy))", "K104"),
}


@pytest.mark.parametrize("name", WRONG_DOMAINS)
def test_what_is_wrong_with_a_domain_is_said_at_its_place(tmp_path: Path, name: str) -> None:
    old, new, code = WRONG_DOMAINS[name]
    assert old in DOMAIN
    with pytest.raises(InvalidInput) as error:
        task(tmp_path, DOMAIN.replace(old, new, 1))
    assert code in [each.code for each in error.value.diagnostics]


def test_deep_nesting_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match="K007"):
        task(tmp_path, "(" * 100_000)
