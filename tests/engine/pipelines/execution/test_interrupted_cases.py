"""A step that prepares a test or a repair fails: what was done before it counts, and the run
goes on from the true state.
"""

from dataclasses import replace

import pytest

from cellwright.engine.model.run_protocol import RecordKind
from cellwright.engine.pipelines.execution import exception_handler
from cellwright.engine.pipelines.execution.compiled_program import activity_alone
from cellwright.engine.pipelines.execution.run_progress import command_of, match_reply
from cellwright.engine.pipelines.planning.checked_plan import problem_of
from cellwright.engine.pipelines.recovery import WorldState
from cellwright.engine.pipelines.simulators import HiddenCell, Injection
from cellwright.kb.asp import ground_term
from cellwright.kb.model.domain_model import Command
from cellwright.kb.model.plan_model import Step, StepId
from cellwright.kb.terms import Function, Variable
from tests.engine.pipelines.execution import executed_cells as cells
from tests.engine.pipelines.execution.executed_cells import executed

MOVED = Injection("us_measure(us_probe, t3_746, m2)", "part_moved", 1, "implausible_value")
BETWEEN = Injection("pick_up(t3_746, slra)", "tool_misplaced")


@pytest.mark.slow
def test_what_was_done_before_a_preparing_step_failed_is_believed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Before the part can be located anew, the tool is changed, and the other one is not where
    it should be.
    """
    wrong, made = list[str](), list[HiddenCell]()

    class Watched(HiddenCell):
        def __post_init__(self) -> None:
            super().__post_init__()
            made.append(self)

    def believe(handler: exception_handler.ExceptionHandler, state: WorldState, why: str) -> None:
        wrong.extend(f"{why}: {fact}" for fact in state.facts ^ made[-1].world.state.facts)
        handler.course.world.become(state)

    monkeypatch.setattr(cells, "HiddenCell", Watched)
    monkeypatch.setattr(exception_handler.ExceptionHandler, "_believe", believe)
    ending, records, _ = executed("bulkhead/both_tools", [MOVED, BETWEEN])
    assert wrong == []
    assert ending.outcome == "reached"
    found = [each.content["exception"] for each in records if each.kind is RecordKind.EXCEPTION]
    assert found[:2] == ["implausible_value", "tool_not_held"]
    assert "while it was looked into, pick_up(t3_746, slra) failed" in ending.story[0]


def test_a_step_outside_of_a_plan_is_sent_as_the_domain_says() -> None:
    problem = problem_of("themse/one")
    sense = ground_term("sense(slippage)")
    assert isinstance(sense, Function)
    activity, pattern = activity_alone(
        problem, Step(StepId(1), sense, (), (Function("slippage"),), 1)
    )
    command = command_of(7, activity)
    assert (command.number, command.stream, command.expects) == (
        7,
        "sensor(slippage)",
        "value(Reading)",
    )
    assert match_reply(pattern, "value(slipping)") == {Variable("Reading"): Function("slipping")}
    assert match_reply(pattern, "no_reading") is None


def test_a_step_without_a_declared_command_goes_to_its_first_resource() -> None:
    problem = problem_of("themse/one")
    domain = problem.domain
    plain = replace(
        domain, operators=tuple(replace(each, command=None) for each in domain.operators)
    )
    opening = Step(
        StepId(1), Function("open_drawer"), (), (Function("mars_gripper"), Function("drawer"))
    )
    command = command_of(0, activity_alone(replace(problem, domain=plain), opening)[0])
    assert (command.stream, command.says) == ("mars_gripper", "open_drawer")
    told = Command(Function("arm"), Function("ok"))
    other = replace(
        domain, operators=tuple(replace(each, command=told) for each in domain.operators)
    )
    assert activity_alone(replace(problem, domain=other), opening)[0].expects == "ok"
