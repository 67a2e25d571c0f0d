"""Grounding ends at its limits, at a request to stop, and hands on what goes wrong."""

import threading
import time
from pathlib import Path

import pytest

from cellwright.kb import stopping
from cellwright.kb.asp import AspError, Grounder, bounded_grounding
from cellwright.kb.asp.static_facts import static_suspects
from cellwright.kb.loader import load_problem

MUCH = "q(0). q(X+1) :- q(X), X < 500000."  # what is left behind goes on to its end


@pytest.fixture(autouse=True)
def _left_to_itself() -> object:
    """What a test leaves behind ends before the next one."""
    yield
    while bounded_grounding.is_left_behind():
        time.sleep(0.05)


@pytest.mark.parametrize(("limit", "value"), [("MAX_GROUNDING_S", 0.05), ("MAX_GROUNDING_MB", 20)])
def test_a_grounding_is_given_up_at_its_limit(
    limit: str, value: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bounded_grounding, limit, value)
    with pytest.raises(bounded_grounding.GroundingTooLarge):
        Grounder().ground(MUCH)


def test_a_grounding_stops_when_it_is_asked_to() -> None:
    asked = []

    def soon() -> bool:
        asked.append(time.monotonic())
        return len(asked) > 2

    with stopping.asking_to_stop(soon), pytest.raises(stopping.StoppedByCaller):
        Grounder().ground(MUCH)
    assert not stopping.is_stop_wanted()


def test_errors_and_answers_come_through() -> None:
    before = threading.active_count()
    grounder = Grounder()
    grounder.ground("a(1..3).")
    assert len(grounder.atoms("a", 1)) == 3
    with pytest.raises(AspError):
        grounder.ground("b(X).")
    assert threading.active_count() == before


DOMAIN = """
domain: blamed
include: [rules.lp]
types: {item: object}
objects: {item: [bolt, nut]}
statics:
  n(int): {}
  pair(item, item): {}
fluents:
  done(item): {}
operators:
  act(Item):
    adds: done(Item)
"""


@pytest.mark.parametrize(
    ("rules", "worst"),
    [
        ("#const k=1000000000.\nn(1..k).\npair(X,Y) :- item(X), item(Y).", "n((1..k))."),
        ("pair(X,Y) :- item(X), item(Y).\nn(1..30000*30000).", "n((1..(30000*30000)))."),
        (
            "n(1..1000).\np(X,Y,Z) :- n(X), n(Y), n(Z).\nr(X) :- n(X).",
            "p(X,Y,Z) :- n(X); n(Y); n(Z).",
        ),
        ("n(1..1000).\nq(f(bolt)).\nq(f(X)) :- q(X).", "q(f(X)) :- q(X)."),
    ],
)
def test_the_rule_that_makes_most_is_blamed(rules: str, worst: str, tmp_path: Path) -> None:
    (tmp_path / "domain.yaml").write_text(DOMAIN)
    (tmp_path / "rules.lp").write_text(rules + "\n")
    (tmp_path / "p.yaml").write_text("problem: p\ndomain: domain.yaml\ngoals: [done(bolt)]\n")
    problem = load_problem(str(tmp_path / "p.yaml"))
    blamed = max(static_suspects(problem), key=lambda each: each.bound)
    assert blamed.what.replace(" ", "") == worst.replace(" ", "")
