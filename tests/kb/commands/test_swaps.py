"""Swaps: each of two things goes to where the other one is."""

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cellwright.engine.model.outcome import Found
from cellwright.engine.pipelines.planning import checked_plan
from cellwright.engine.stages.validation.operator_semantics import Semantics
from cellwright.kb.commands import understand_command
from cellwright.kb.commands.swaps import StartPlaces, place_fluents
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.loader import find_target, load, load_problem
from cellwright.kb.model.domain_model import Domain
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Atom, Function, Number

ROOM = """domain: room
types: {book: object, shelf: object}
objects: {book: [red, blue, green], shelf: [upper, lower, floor]}
fluents:
  lies(book, shelf): {}
  vacant(shelf): {}
  open(book): {}
operators:
  put(B, From, To):
    preconditions: lies(B, From), vacant(To)
    adds: lies(B, To), vacant(From)
    deletes: lies(B, From), vacant(To)
defaults: ["lies(red, upper)", "lies(blue, lower)", "vacant(floor)"]
commands:
  phrases:
    - say: "put {B:book} on {S:shelf}"
      goal: lies(B, S)
"""


@pytest.fixture
def room(tmp_path: Path) -> Domain:
    (tmp_path / "domain.yaml").write_text(ROOM)
    return load(tmp_path / "domain.yaml").domain


def goals_of(domain: Domain, text: str) -> str:
    return str(understand_command(domain, text).goal)


SWAPS = ["swap red and blue", "exchange the red book with blue", "let red and blue change places"]


@pytest.mark.parametrize("text", [*SWAPS, "please swap the places of red and blue"])
def test_a_swap_asks_for_the_place_of_the_other(room: Domain, text: str) -> None:
    assert list(place_fluents(room)) == [("lies", "book")]
    assert goals_of(room, text) == "lies(red, lower), lies(blue, upper)"


def test_a_swap_is_planned(room: Domain) -> None:
    outcome = checked_plan.plan_problem(understand_command(room, SWAPS[0]))
    assert isinstance(outcome, Found)
    assert len(outcome.plan.steps) == 3


def test_a_swap_behind_an_act_begins_where_that_act_ends(room: Domain) -> None:
    chains = understand_command(room, "put red on the floor, then swap red and blue").chains
    assert [list(map(str, chain.stages))[-1] for chain in chains[-2:]] == [
        "lies(red, lower)",
        "lies(blue, floor)",
    ]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("swap red and green", "nobody can say where green is"),
        ("swap all books", "a swap is of two things"),
        ("swap upper and lower", "upper is a shelf"),
        ("swap", ""),
    ],
)
def test_a_swap_without_places_is_refused(room: Domain, text: str, said: str) -> None:
    with pytest.raises(InvalidInput) as error:
        understand_command(room, text)
    assert said in error.value.diagnostics[0].message


def test_a_phrase_of_the_domain_comes_before(tmp_path: Path) -> None:
    own = '    - say: "swap {A:book} (and|with) {B:book}"\n      goal: open(A)\n'
    (tmp_path / "domain.yaml").write_text(ROOM + own)
    domain = load(tmp_path / "domain.yaml").domain
    assert goals_of(domain, "swap red with blue") == "open(red)"


def test_a_problem_file_may_ask_for_a_swap(tmp_path: Path) -> None:
    file = tmp_path / "p.yaml"
    file.write_text("problem: p\ndomain: themse\ncommand: swap probes 1 and 3\n")
    wanted = "at(probe_1, slot(drawer, 3)), at(probe_3, slot(drawer, 1))"
    assert str(load_problem(str(file)).goal) == wanted


@settings(max_examples=15, deadline=None)
@given(st.dictionaries(st.integers(1, 4), st.integers(0, 4), max_size=4))
def test_the_places_at_the_start_are_those_of_the_checker(slots: dict[int, int]) -> None:
    domain = load(find_target("themse")).domain
    free = dict(zip(slots.values(), slots, strict=True))  # one probe for each place
    initial = tuple(
        Function("at", (Function(f"probe_{probe}"), _depot(slot))) for slot, probe in free.items()
    )
    problem = Problem("drawn", domain, initial=initial)
    state = Semantics(problem).initial()
    start = StartPlaces(problem, domain.objects)
    for probe in (Function(f"probe_{number}") for number in range(1, 5)):
        places = [a.arguments[1] for a in state if a.name == "at" and a.arguments[0] == probe]
        assert start.of(probe, "at") == (places[0] if len(places) == 1 else None)


def _depot(slot: int) -> Atom:
    name = Function("drawer" if slot else "furnace")
    return Function("slot", (name, Number(max(slot, 1))))
