"""Sub-sequences that recur and pay become operators of later searches; those that do not, or
have gone stale, do not.
"""

import json
from dataclasses import replace
from pathlib import Path

import pytest
from typer.testing import CliRunner

from cellwright.engine.faces.cli import app
from cellwright.engine.formats.interop.pddl import read_pddl_task
from cellwright.engine.model.outcome import Found, MacroOffer, Statistics
from cellwright.engine.pipelines.planning import checked_plan
from cellwright.engine.pipelines.planning.macros import LibraryPlanner
from cellwright.engine.pipelines.planning.macros.macro_exchange import macro_records
from cellwright.engine.pipelines.planning.macros.macro_subsequences import (
    MAX_FAILED_TRIALS,
    SUBSEQUENCE_SIGNATURE,
    Subsequences,
    pattern_of,
)
from cellwright.engine.stages.macros.learning.plan_subsequences import matches_pattern
from cellwright.engine.stages.planning import SearchLimits
from cellwright.engine.stages.planning.macro_utility import measure_utility
from cellwright.engine.stages.validation import validate_plan
from cellwright.kb.model.domain_model import Domain, Operator
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.store import Library, document, macrop_of
from cellwright.kb.store.usage_counts import RARELY, Utility

DOMAIN = """
(define (domain parcels) (:requirements :strips)
  (:predicates (at ?x ?l) (in ?p ?t) (truck ?t) (parcel ?p) (road ?a ?b))
  (:action load :parameters (?p ?t ?l)
    :precondition (and (parcel ?p) (truck ?t) (at ?p ?l) (at ?t ?l)) :effect (and (in ?p ?t) (not (at ?p ?l))))
  (:action unload :parameters (?p ?t ?l)
    :precondition (and (parcel ?p) (truck ?t) (in ?p ?t) (at ?t ?l)) :effect (and (at ?p ?l) (not (in ?p ?t))))
  (:action drive :parameters (?t ?a ?b)
    :precondition (and (truck ?t) (at ?t ?a) (road ?a ?b)) :effect (and (at ?t ?b) (not (at ?t ?a)))))
"""


def parcels(folder: Path, moves: str, name: str = "day") -> Problem:
    """A truck for each letter, which moves its parcel from one town to the next: `ab` from a to
    b.
    """
    towns = "abcd"
    numbers = range(len(moves.split()))
    roads = " ".join(f"(road {a} {b})" for a in towns for b in towns if a != b)
    there = " ".join(f"(parcel p{n}) (at p{n} {move[0]})" for n, move in enumerate(moves.split()))
    wanted = " ".join(f"(at p{n} {move[1]})" for n, move in enumerate(moves.split()))
    things = " ".join(f"p{n}" for n in numbers)
    text = (
        f"(define (problem {name}) (:domain parcels) (:objects {things} t1 t2 "
        f"{' '.join(towns)}) (:init {roads} {there} "
        f"(truck t1) (truck t2) (at t1 a) (at t2 c)) (:goal (and {wanted})))"
    )
    (folder / "domain.pddl").write_text(DOMAIN)
    (folder / f"{name}.pddl").write_text(text)
    return read_pddl_task(folder / "domain.pddl", folder / f"{name}.pddl").problem


@pytest.fixture
def library(tmp_path: Path) -> Library:
    return Library(str(tmp_path / "library.db"))


def taught(library: Library, problem: Problem) -> Subsequences:
    with LibraryPlanner(library) as practice:
        practice.plan(problem)
        return practice.subsequences(problem.domain)


def test_what_recurs_and_pays_is_kept_with_its_figures(library: Library, tmp_path: Path) -> None:
    known = taught(library, parcels(tmp_path, "ab bc cd da ac bd"))
    kept = library.serving("parcels", SUBSEQUENCE_SIGNATURE)
    figures = library.utilities("parcels")
    assert kept
    for each in kept:
        mine = [utility for (number, _), utility in figures.items() if number == each.id]
        assert any(utility.pays for utility in mine)
        assert each.uses >= 2
        assert each.macrop.depends
    offered = known.offered()
    assert {*offered.backward, *offered.forward} <= {pattern_of(each.macrop) for each in kept}
    assert offered.backward or offered.forward


def test_a_kept_subsequence_serves_another_task_and_is_counted(
    library: Library, tmp_path: Path
) -> None:
    taught(library, parcels(tmp_path, "ab bc cd da ac bd"))
    problem = parcels(tmp_path, "ba cb dc ad ca db ab", "other")
    offers = Subsequences(library, problem.domain).offered()
    searches = [search for search in ("backward", "forward") if getattr(offers, search)]
    assert searches
    for search in searches:
        known = Subsequences(library, problem.domain)
        outcome, _ = checked_plan.plan_and_ground(
            problem, SearchLimits(strategy=search), known.offered()
        )
        assert isinstance(outcome, Found)
        assert validate_plan(problem, outcome.plan) == []
        offer = outcome.statistics.offer
        assert offer.search in ("", search)
        before = library.utilities()
        known.note(outcome.statistics)
        after = library.utilities()
        for (number, kind), utility in after.items():
            had = before.get((number, kind), Utility())
            assert utility.offered - had.offered == (kind == offer.search and bool(offer.offered))
        assert sum(u.used for u in after.values()) == len(offer.used) + sum(
            u.used for u in before.values()
        )


def test_trials_repeat_and_count_the_work_without_once(tmp_path: Path, library: Library) -> None:
    problem = parcels(tmp_path, "ab bc cd da")
    _, task = checked_plan.plan_and_ground(problem)
    known = taught(library, problem)
    patterns = [
        pattern_of(each.macrop) for each in library.serving("parcels", SUBSEQUENCE_SIGNATURE)
    ]
    assert patterns
    for search in ("backward", "forward"):
        first = measure_utility(task, search, patterns)
        assert first == measure_utility(task, search, patterns)
        assert set(first) == set(patterns)
        assert all(trial.beside <= 2 * trial.without for trial in first.values())
        assert measure_utility(task, search, patterns, lambda: True) == {}
    assert known.domain is problem.domain


def test_after_an_edit_of_an_operator_nothing_that_rests_on_it_is_offered(
    library: Library, tmp_path: Path
) -> None:
    problem = parcels(tmp_path, "ab bc cd da ac bd")
    taught(library, problem)
    domain = problem.domain

    def edited(name: str) -> Domain:
        operators = tuple(_holding(o) if o.name == name else o for o in domain.operators)
        return replace(domain, operators=operators)

    for name in ("load", "drive", "unload"):
        offered = Subsequences(library, edited(name)).offered()
        for pattern in (*offered.backward, *offered.forward):
            assert name not in {step.name for step in pattern}


def _holding(operator: Operator) -> Operator:
    return replace(operator, resources=(*operator.resources, operator.parameters[0].variable))


@pytest.mark.slow
def test_what_pays_nowhere_is_dropped_and_what_is_offered_in_vain_is_offered_no_more(
    library: Library, tmp_path: Path
) -> None:
    problem = parcels(tmp_path, "ab bc cd da ac bd")
    known = taught(library, problem)
    kept = library.serving("parcels", SUBSEQUENCE_SIGNATURE)
    vain = {
        (each.id, search): Utility(offered=RARELY)
        for each in kept
        for search in ("backward", "forward")
    }
    library.note_utilities(vain)
    assert Subsequences(library, problem.domain).offered() == type(known.offered())()
    loss = {key: Utility(trials=MAX_FAILED_TRIALS, without=1, beside=10**9) for key in vain}
    library.note_utilities(loss)
    taught(library, parcels(tmp_path, "ba cb dc ad", "more"))
    assert not {each.id for each in kept} & {
        each.id for each in library.serving("parcels", SUBSEQUENCE_SIGNATURE)
    }


def test_they_are_exported_and_imported_as_what_they_are_and_never_looked_up(
    library: Library, tmp_path: Path
) -> None:
    problem = parcels(tmp_path, "ab bc cd da ac bd")
    taught(library, problem)
    copies = [macrop_of(document(each.macrop)) for each in library.all() if each.macrop.subsequence]
    assert copies
    with Library(str(tmp_path / "other.db")) as other:
        other.add(macro_records(copies))
        assert [each.macrop for each in other.serving("parcels", SUBSEQUENCE_SIGNATURE)] == copies
        with LibraryPlanner(other) as practice:
            repertoire = practice.repertoire(problem.domain)
            repertoire.load()
            assert len(repertoire) == 0


@pytest.mark.slow
def test_a_library_that_is_only_used_is_left_as_it_is(library: Library, tmp_path: Path) -> None:
    taught(library, parcels(tmp_path, "ab bc cd da ac bd"))
    before = (library.utilities(), library.serving("parcels", SUBSEQUENCE_SIGNATURE))
    with LibraryPlanner(library, SearchLimits(strategy="forward"), learns=False) as practice:
        answered = practice.plan(parcels(tmp_path, "ba cb dc ad ca", "other"))
    assert isinstance(answered.outcome, Found)
    assert (library.utilities(), library.serving("parcels", SUBSEQUENCE_SIGNATURE)) == before


def test_what_no_search_was_offered_is_not_counted(library: Library, tmp_path: Path) -> None:
    known = taught(library, parcels(tmp_path, "ab bc cd da ac bd"))
    before = library.utilities()
    known.note(Statistics())
    known.note(Statistics(offer=MacroOffer("forward", (), ())))
    assert library.utilities() == before


@pytest.mark.slow
def test_a_folded_plan_has_every_step_once_and_shows_the_macrops_in_it(
    library: Library, tmp_path: Path
) -> None:
    problem = parcels(tmp_path, "ab bc cd da ac bd")
    known = taught(library, problem)
    outcome = checked_plan.plan_problem(problem)
    assert isinstance(outcome, Found)
    parts = known.folded(outcome.plan)
    assert sorted(step for part in parts for step in part.steps) == [
        step.id for step in outcome.plan.steps
    ]
    steps = {step.id: step.operator for step in outcome.plan.steps}
    patterns = {
        each.id: pattern_of(each.macrop)
        for each in library.serving("parcels", SUBSEQUENCE_SIGNATURE)
    }
    inner = [part for part in parts if part.macrop is not None]
    assert inner
    for part in inner:
        assert part.macrop is not None
        assert matches_pattern(patterns[part.macrop], [steps[each] for each in part.steps])


def test_commands_tell_what_searches_had_of_subsequences(library: Library, tmp_path: Path) -> None:
    taught(library, parcels(tmp_path, "ab bc cd da ac bd"))
    listed, told = (
        CliRunner().invoke(app, ["macros", verb, "--store", library.target, "--format", "json"])
        for verb in ("list", "stats")
    )
    kept = {each.id for each in library.serving("parcels", SUBSEQUENCE_SIGNATURE)}
    figures = library.utilities()
    for entry in json.loads(listed.stdout)["data"]["macrops"]:
        assert ("in_search" in entry) == (entry["number"] in kept)
        for search, found in entry.get("in_search", {}).items():
            assert found["without"] == figures[entry["number"], search].without
    assert json.loads(told.stdout)["data"]["subsequences"]["macrops"] == len(kept)
    text = (
        CliRunner()
        .invoke(app, ["macros", "list", "--store", library.target], env={"COLUMNS": "200"})
        .stdout
    )
    assert "in search" in text
