"""Everyday words: names that facts give, places of errors in sentences that are said otherwise,
and things that are in the way.
"""

from pathlib import Path

import pytest

from cellwright.engine.model.outcome import Found
from cellwright.engine.pipelines.planning import checked_plan
from cellwright.engine.pipelines.planning.taken_places import find_taken_places
from cellwright.kb.commands import understand_command
from cellwright.kb.commands.everyday_wordings import sayings
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.loader import find_target, load, load_problem


def test_an_object_is_called_as_a_fact_says(tmp_path: Path) -> None:
    file = tmp_path / "p.yaml"
    file.write_text(
        'problem: p\ndomain: themse\nstatics:\n  - sample_name(probe_1, "A17"), '
        'sample_name(probe_2, "blue one")\n'
        "goals: [stored(probe_1)]\n"
    )
    problem = load_problem(str(file))
    for said in ("heat A17 for 5 min", "heat sample a17 for 5 min", "anneal probe 1 for 5 min"):
        (chain,) = understand_command(problem, said).chains
        assert list(map(str, chain.stages)) == ["heated(probe_1, 300)"]
    (chain,) = understand_command(problem, "cool the blue one for 5 min").chains
    assert list(map(str, chain.stages)) == ["cooled(probe_2, 300)"]


def test_an_everyday_verb_without_a_phrase_shows_the_nearest_ones() -> None:
    text = "open the drawer, then preheat the furnace"
    with pytest.raises(InvalidInput) as error:
        understand_command(load(find_target("themse")).domain, text)
    (finding,) = error.value.diagnostics
    assert text[finding.where.column - 1 :] == "preheat the furnace"
    assert "(process|heat) <probe>" in finding.hint


@pytest.mark.parametrize("verb", ["heat up", "turn on", "switch on"])
def test_a_device_is_preheated_as_the_domain_says(tmp_path: Path, verb: str) -> None:
    (tmp_path / "domain.yaml").write_text(
        "domain: kitchen\ntypes: {oven: object}\nobjects: {oven: [oven]}\n"
        "fluents:\n  hot(oven): {}\noperators:\n  light(O):\n    adds: hot(O)\n"
        f"commands:\n  phrases:\n    - say: {verb} {{O:oven}}\n      goal: hot(O)\n"
    )
    domain = load(tmp_path / "domain.yaml").domain
    assert str(understand_command(domain, "preheat the oven").goal) == "hot(oven)"


@pytest.mark.parametrize(
    "said", ["the left station", "station left", "left", "the left", "left stand"]
)
def test_a_station_is_called_by_its_name(said: str) -> None:
    problem = load_problem("bulkhead/three_stations")
    asked = understand_command(problem, f"go to {said}")
    assert "stands" in str(asked.goal)
    assert "left" in str(asked.goal)
    chains = understand_command(problem, f"drive to {said}, then measure b1").chains
    assert str(chains[0].stages[0]) == "stands(_, left)"


def test_an_error_in_a_sentence_said_otherwise_is_at_its_place() -> None:
    text = "heat probe 1 again for 5 min, then put away probe 9"
    with pytest.raises(InvalidInput) as error:
        understand_command(load(find_target("themse")).domain, text)
    (found,) = error.value.diagnostics
    assert text[found.where.column - 1 :].startswith("put away probe 9")


@pytest.mark.parametrize(
    "text", ["heat it again for 5 min", "a, then back to b", "put them away", "x when done."]
)
def test_places_of_other_sayings_lie_in_the_sentence(text: str) -> None:
    for saying in sayings(text):
        assert all(0 <= saying.original(place) <= len(text) for place in range(len(saying.text)))


def test_a_place_that_is_taken_is_said() -> None:
    problem = understand_command(load(find_target("themse")).domain, "move probe 3 to slot 1")
    outcome = checked_plan.plan_problem(problem)
    assert isinstance(outcome, Found)
    (found,) = find_taken_places(problem, outcome.plan)
    assert "is taken at the start by at(probe_1, slot(drawer, 1))" in found.message
    free = understand_command(load(find_target("themse")).domain, "move probe 3 to slot 3")
    outcome = checked_plan.plan_problem(free)
    assert isinstance(outcome, Found)
    assert not list(find_taken_places(free, outcome.plan))
