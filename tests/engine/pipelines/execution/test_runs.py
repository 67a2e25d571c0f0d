"""Whole runs on the virtual clock: without faults, with faults, with orders."""

import pytest

from cellwright.engine.formats.report.runs.run_report import narrate_record
from cellwright.engine.model.run_protocol import OperatorCommand, RecordKind
from cellwright.engine.pipelines.execution import GivenOrder, TimedOrders
from cellwright.engine.pipelines.simulators import Injection
from cellwright.engine.pipelines.simulators.simulator_settings import SimulatorSettings
from tests.engine.pipelines.execution.executed_cells import executed, planned

PICK = "pick(probe_1, slot(drawer, 1))"


def of(records, kind):
    return [each for each in records if each.kind is kind]


def test_a_run_without_faults_takes_as_long_as_its_schedule() -> None:
    _, ready = planned("themse/one")
    ending, records, cell = executed("themse/one")
    assert (ending.outcome, ending.makespan_ms) == ("reached", ready.makespan * 1000)
    assert cell.world.reached == {"1:probe_1": 3}
    assert [each.number for each in records] == list(range(1, len(records) + 1))


def test_nothing_is_sent_that_is_not_noted_before_and_every_step_is_done_once() -> None:
    _, records, _ = executed("themse/one")
    sent = [each.content["action"] for each in of(records, RecordKind.COMMAND)]
    done = [each.content["action"] for each in of(records, RecordKind.DONE)]
    assert sorted(sent) == sorted(done)


def test_what_is_believed_at_the_end_is_what_is_so() -> None:
    _, records, cell = executed("themse/one", [Injection(PICK, "not_gripped")])
    facts: set[str] = set()
    for each in records:
        if each.kind in (RecordKind.DONE, RecordKind.WORLD):
            facts = (facts - set(each.content["ends"])) | set(each.content["adds"])
    assert facts <= set(map(str, cell.world.facts))


@pytest.mark.parametrize(
    ("step", "cause", "outcome"),
    [
        (PICK, "not_gripped", "reached"),
        (PICK, "width_sensor_defective", "reached"),
        ("heat(probe_1, slot(furnace, 1), 900)", "furnace_cold", "reached"),
        ("heat(probe_1, slot(furnace, 1), 900)", "heater_broken", "stopped"),
        ("put(probe_1, slot(drawer, 1))", "depot_occupied", "partly"),
    ],
)
def test_a_fault_ends_in_goals_reached_or_given_up_with_reasons_or_a_safe_stop(
    step: str, cause: str, outcome: str
) -> None:
    ending, records, cell = executed("themse/one", [Injection(step, cause)])
    assert ending.outcome == outcome
    assert of(records, RecordKind.EXCEPTION)
    assert of(records, RecordKind.DIAGNOSIS)
    if outcome == "reached":
        assert cell.world.reached == {"1:probe_1": 3}
    else:
        assert {goal for goal, why in ending.given_up if why} == set(ending.open_goals)


def test_a_fault_that_is_met_twice_is_put_right_twice() -> None:
    faults = [Injection("pick", "not_gripped", 1), Injection("pick", "not_gripped", 3)]
    ending, records, _ = executed("themse/one", faults)
    assert (ending.outcome, len(of(records, RecordKind.EXCEPTION))) == ("reached", 2)


@pytest.mark.parametrize("at_ms", [0, 5_000, 30_000, 400_000])
def test_a_stop_takes_effect_at_once(at_ms: int) -> None:
    ending, records, _ = executed(
        "themse/one", orders=TimedOrders([(at_ms, GivenOrder(OperatorCommand.STOP))])
    )
    assert (ending.outcome, ending.makespan_ms) == ("stopped", at_ms)
    assert not [each for each in of(records, RecordKind.COMMAND) if each.at_ms > at_ms]


def test_an_interruption_pauses_with_empty_hands_and_the_run_goes_on_when_told() -> None:
    orders = TimedOrders(
        [
            (10_000, GivenOrder(OperatorCommand.INTERRUPT)),
            (100_000, GivenOrder(OperatorCommand.CONTINUE)),
        ]
    )
    ending, records, _ = executed("themse/one", orders=orders)
    paused = next(
        each for each in of(records, RecordKind.PHASE) if each.content["phase"] == "paused"
    )
    between = [
        each for each in of(records, RecordKind.COMMAND) if paused.at_ms <= each.at_ms < 100_000
    ]
    assert paused.at_ms == 25_000  # the probe that was in the gripper is in the furnace
    assert [each.content["stream"] for each in between] == []
    assert ending.outcome == "reached"


@pytest.mark.parametrize("at_ms", [10_000, 400_000])
def test_a_pause_is_noted_once_whether_it_comes_at_once_or_later(at_ms: int) -> None:
    orders = TimedOrders(
        [
            (at_ms, GivenOrder(OperatorCommand.INTERRUPT)),
            (950_000, GivenOrder(OperatorCommand.CONTINUE)),
        ]
    )
    _, records, _ = executed("themse/one", orders=orders)
    said = [line for each in records for line in narrate_record(each) if "paused" in line]
    assert len(said) == 1


def test_a_stop_is_told_once() -> None:
    _, records, _ = executed(
        "themse/one", orders=TimedOrders([(5_000, GivenOrder(OperatorCommand.STOP))])
    )
    said = [line for each in records for line in narrate_record(each) if "stopped" in line]
    assert len(said) == 1


def test_what_an_order_begins_is_sent_before_anything_is_waited_for() -> None:
    orders = TimedOrders(
        [
            (10_000, GivenOrder(OperatorCommand.INTERRUPT)),
            (100_000, GivenOrder(OperatorCommand.CONTINUE)),
        ]
    )
    _, records, _ = executed("themse/one", orders=orders)
    begun = [each.content["started_ms"] for each in of(records, RecordKind.DONE)]
    ended = next(
        each for each in of(records, RecordKind.DONE) if each.content["started_ms"] == 100_000
    )
    assert (begun.count(100_000), ended.at_ms) == (1, 103_000)


def test_a_pause_that_nobody_ends_is_the_end() -> None:
    ending, _, _ = executed(
        "themse/one", orders=TimedOrders([(10_000, GivenOrder(OperatorCommand.INTERRUPT))])
    )
    assert ending.outcome == "paused"


def test_a_run_that_is_not_approved_moves_nothing() -> None:
    ending, records, _ = executed("themse/one", approve=True)
    assert (ending.outcome, of(records, RecordKind.COMMAND)) == ("aborted", [])
    ending, _, _ = executed(
        "themse/one", orders=TimedOrders([(0, GivenOrder(OperatorCommand.APPROVE))]), approve=True
    )
    assert ending.outcome == "reached"


@pytest.mark.slow
def test_a_step_done_by_hand_is_skipped_at_a_pause() -> None:
    orders = TimedOrders(
        [
            (10_000, GivenOrder(OperatorCommand.INTERRUPT)),
            (950_000, GivenOrder(OperatorCommand.SKIP, "turn_bayonet(locked, unlocked)")),
            (950_001, GivenOrder(OperatorCommand.CONTINUE)),
        ]
    )
    ending, records, _ = executed("themse/one", orders=orders)
    done = [each.content["action"] for each in of(records, RecordKind.DONE)]
    assert "turn_bayonet(locked, unlocked)" not in done[: done.index("pick(lid, rim)")]
    assert ending.outcome == "reached"


def test_a_simulated_cell_is_told_what_a_hand_has_done() -> None:
    """What was skipped or corrected is so in the cell: later steps find it there, and the goals
    are reached in truth.
    """
    pause, go_on = (
        (10_000, GivenOrder(OperatorCommand.INTERRUPT)),
        (30_001, GivenOrder(OperatorCommand.CONTINUE)),
    )
    skipped = (30_000, GivenOrder(OperatorCommand.SKIP, "press_switch(open, closed)"))
    ending, records, cell = executed("themse/one", orders=TimedOrders([pause, skipped, go_on]))
    done = [each.content["action"] for each in of(records, RecordKind.DONE)]
    assert "press_switch(open, closed)" not in done
    assert (ending.outcome, cell.world.reached) == ("reached", {"1:probe_1": 3})
    corrected = (
        30_000,
        GivenOrder(OperatorCommand.CORRECT, "position(flap, closed); -position(flap, open)"),
    )
    ending, _, cell = executed("themse/one", orders=TimedOrders([pause, corrected, go_on]))
    assert (ending.outcome, cell.world.reached) == ("reached", {"1:probe_1": 3})


def test_durations_that_vary_do_not_keep_goals_from_being_reached() -> None:
    for seed in range(3):
        ending, _, cell = executed("themse/one", settings=SimulatorSettings(seed, spread=0.2))
        assert (ending.outcome, cell.world.reached) == ("reached", {"1:probe_1": 3})


def test_a_device_with_a_queue_gets_commands_ahead_and_takes_no_longer() -> None:
    _, ready = planned("themse/one")
    ending, records, _ = executed("themse/one", settings=SimulatorSettings(lookahead=4))
    kinds = {each.content["command_kind"] for each in of(records, RecordKind.COMMAND)}
    assert {"wait", "continue"} <= kinds
    assert (ending.outcome, ending.makespan_ms) == ("reached", ready.makespan * 1000)


def test_a_person_answers_before_the_cell_does() -> None:
    fault = [Injection("heat(probe_1, slot(furnace, 1), 900)", "furnace_off")]
    _, records, _ = executed("themse/one", fault)
    asked = next(each for each in of(records, RecordKind.COMMAND) if each.content["asks"])
    orders = [
        (asked.at_ms + 500, GivenOrder(OperatorCommand.ANSWER, "dance")),
        (asked.at_ms + 1_000, GivenOrder(OperatorCommand.ANSWER, "cured")),
    ]
    ending, records, _ = executed("themse/one", fault, orders=TimedOrders(orders))
    replies = [
        each
        for each in of(records, RecordKind.REPLY)
        if each.content["command"] == asked.content["command"]
    ]
    assert (replies[0].at_ms, replies[0].content["text"]) == (asked.at_ms + 1_000, "cured")
    assert "answer refused" in [each.content["what"] for each in of(records, RecordKind.DECISION)]
    assert ending.outcome in (
        "reached",
        "stopped",
    )  # the cell itself is put right only when the person has done it


def test_a_fault_that_did_not_come_up_is_told() -> None:
    faults = [Injection("pick", "not_gripped", 40), Injection(PICK, "not_gripped")]
    ending, _, _ = executed("themse/one", faults)
    told = [each for each in ending.story if "did not come up" in each]
    assert told == ["pick#40=not_gripped did not come up: there were fewer such steps"]
