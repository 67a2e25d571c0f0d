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
