"""Runs that count: what a person does or corrects at a pause leaves each quantity with one
value.
"""

from pathlib import Path

import pytest

from cellwright.engine.model.run_protocol import OperatorCommand, RecordKind
from cellwright.engine.pipelines.execution import GivenOrder, TimedOrders
from cellwright.engine.pipelines.recovery import Dynamics
from cellwright.kb.asp import ground_term
from cellwright.kb.loader import load_problem
from cellwright.kb.terms import Function
from tests.engine.pipelines.execution.executed_cells import executed

DOMAIN = """
domain: doses
units: {time: s}
types: {tube: object}
quantities:
  level: 0..200
events:
  dosed(tube, int): {}
operators:
  dose(Tube, Amount):
    preconditions: level >= Amount
    adds: dosed(Tube, Amount)
    decrease: {level: Amount}
    resources: pipettor
    duration: 10 s
    command: {stream: pipettor(dose(Amount)), reply: done}
"""
PROBLEM = """
problem: four
domain: doses
objects: {tube: [a, b, c, d]}
initial: [level(200)]
workflow:
  - for: {T: [a]}
    stages: dosed(T, 10)
  - for: {T: [b]}
    stages: dosed(T, 20)
  - for: {T: [c]}
    stages: dosed(T, 30)
  - for: {T: [d]}
    stages: dosed(T, 40)
"""


@pytest.fixture
def four(tmp_path: Path) -> str:
    (tmp_path / "problems").mkdir()
    (tmp_path / "domain.yaml").write_text(DOMAIN, "utf-8")
    path = tmp_path / "problems" / "four.yaml"
    path.write_text(PROBLEM, "utf-8")
    return str(path)


def levels(facts: set[str]) -> list[str]:
    return [each for each in facts if each.startswith("level")]


@pytest.mark.parametrize("done", ["dose(a, 10)", "dose(b, 20)", "dose(c, 30)", "dose(d, 40)"])
def test_what_is_done_by_hand_out_of_turn_counts_from_the_value_that_there_is(
    four: str, done: str
) -> None:
    orders = [
        (5_000, GivenOrder(OperatorCommand.INTERRUPT)),
        (15_000, GivenOrder(OperatorCommand.SKIP, done)),
        (15_001, GivenOrder(OperatorCommand.CONTINUE)),
    ]
    ending, records, _ = executed(four, orders=TimedOrders(orders))
    said = [each.content.get("what", "") for each in records if each.kind is RecordKind.DECISION]
    first = next(each.content["action"] for each in records if each.kind is RecordKind.DONE)
    assert ("skip refused" in said) == (first.replace(" ", "") == done.replace(" ", ""))
    facts: set[str] = {"level(200)"}
    for each in records:
        if each.kind in (RecordKind.DONE, RecordKind.WORLD):
            facts = (facts - set(each.content["ends"])) | set(each.content["adds"])
    assert (ending.outcome, levels(facts)) == ("reached", ["level(100)"])


def test_a_corrected_quantity_has_its_new_value_only(four: str) -> None:
    dynamics = Dynamics(load_problem(four))
    said = ground_term("level(50)")
    assert isinstance(said, Function)
    now = dynamics.asserted(dynamics.start().facts, (said,))
    assert levels(set(map(str, now))) == ["level(50)"]
