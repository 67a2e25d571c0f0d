"""Late choice: equal things exchange their roles when waiting would begin otherwise, and
nothing is lost by it.
"""

from pathlib import Path

import pytest

from cellwright.engine.model.run_protocol import RecordKind
from cellwright.engine.pipelines.execution import plan_review
from cellwright.engine.pipelines.execution.plan_review import possible_exchanges
from cellwright.engine.pipelines.planning.checked_plan import problem_of
from cellwright.engine.pipelines.planning.plan_gate import PlanGate
from cellwright.engine.pipelines.simulators.simulator_settings import SimulatorSettings
from cellwright.kb.asp import ground_term
from cellwright.kb.model.plan_model import Step, StepId
from cellwright.kb.terms import Function
from tests.engine.pipelines.execution.executed_cells import executed

FOUR = str(Path(__file__).parents[3] / "domains" / "bakery" / "problems" / "four.yaml")
LATE = SimulatorSettings(8, spread=0.4)


def function(text: str) -> Function:
    found = ground_term(text)
    assert isinstance(found, Function)
    return found


@pytest.mark.slow
def test_what_is_ready_takes_the_part_of_what_is_late(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(plan_review, "PAYS_MS", 10**9)  # only choices, no other order
    ending, records, cell = executed(FOUR, settings=LATE)
    chosen = [
        each.content["what"]
        for each in records
        if each.kind is RecordKind.DECISION and each.content["what"].startswith("exchanged")
    ]
    assert "oven_1 and oven_2" in chosen[0]
    assert ending.outcome == "reached"
    assert all(cell.world.reached[chain.name] == 1 for chain in problem_of(FOUR).chains)
    done = [each.content["action"] for each in records if each.kind is RecordKind.DONE]
    assert len(done) == len(set(done)) == 20
    monkeypatch.setattr(plan_review, "exchange_choices", lambda *_: ())
    assert executed(FOUR, settings=LATE)[0].makespan_ms > ending.makespan_ms


def test_all_that_goes_with_equal_things_is_exchanged_with_them() -> None:
    problem = problem_of("themse/two")
    facts = [
        function(text)
        for text in ("at(probe_1, slot(furnace, 1))", "at(probe_2, slot(furnace, 2))")
    ]
    steps = [Step(StepId(n), function(f"pick(probe_{n}, slot(furnace, {n}))")) for n in (1, 2)]
    found = next(possible_exchanges(problem, facts, [function("probe_1")], steps, PlanGate()))
    named = {str(one): str(other) for one, other in found.items()}
    assert named["probe_1"] == "probe_2"
    assert named["slot(furnace, 2)"] == "slot(furnace, 1)"
    assert named["slot(drawer, 1)"] == "slot(drawer, 2)"
