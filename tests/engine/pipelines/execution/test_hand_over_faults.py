"""What goes wrong at a hand-over is diagnosed and put right in the run, whatever its cause; or
the run says what is lost.
"""

import pytest

from cellwright.engine.model.run_protocol import RecordKind
from cellwright.engine.pipelines.simulators import Injection
from cellwright.engine.pipelines.simulators.virtual_clock import fault_base
from tests.engine.pipelines.execution.executed_cells import executed, planned

STEP = "hand_over(left, right, rod_1)"
FAILURES = {
    "not_taken": ("taken_beside", "item_slipped", "arms_misaligned", "taker_sensor_defective"),
    "not_released": ("hand_sticks", "item_tilted", "release_sensor_defective"),
    "lost_between": ("item_dropped", "taker_sensor_defective"),
}
# The pick, the hand-over that succeeds in the end, and the put. A sensor that lies has not undone
# the hand-over.
STEPS = {"item_dropped": 1, "taker_sensor_defective": 2, "release_sensor_defective": 2}
CASES = [(cause, exception) for exception, causes in FAILURES.items() for cause in causes]


def test_each_cause_of_the_fault_base_is_tried() -> None:
    base = fault_base(planned("dual/over")[0])
    assert base is not None
    known = {
        name: set(each.counts)
        for name, each in base.exceptions.items()
        if each.operator is not None and each.operator.name == "hand_over"
    }
    assert known == {name: set(causes) for name, causes in FAILURES.items()}


@pytest.mark.parametrize(("cause", "exception"), CASES)
def test_a_fault_at_a_hand_over_is_found_and_put_right(cause: str, exception: str) -> None:
    ending, records, cell = executed("dual/over", [Injection(STEP, cause, 1, exception)])
    (case,) = [each.content for each in records if each.kind is RecordKind.DIAGNOSIS]
    assert (case["exception"], case["isolated"]) == (exception, True)
    assert case["causes"] == [[cause, 1.0]]
    facts = set(map(str, cell.world.facts))
    assert {"empty(left)", "empty(right)"} <= facts
    assert ("at(rod_1, shelf_1)" in facts) == (cause != "item_dropped")
    assert ending.outcome == ("partly" if cause == "item_dropped" else "reached")
    assert ending.steps == STEPS.get(cause, 3)


def test_a_rod_is_not_given_up_before_anybody_has_looked() -> None:
    _, records, _ = executed("dual/over", [Injection(STEP, "item_dropped")])
    done = [each.content["action"] for each in records if each.kind is RecordKind.FINDING]
    assert done.index("look") < done.index("go_on_without")
