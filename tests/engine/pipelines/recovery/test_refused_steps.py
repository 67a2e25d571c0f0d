"""Steps that cannot be taken: what is said of them."""

from cellwright.engine.pipelines.planning.checked_plan import problem_of
from cellwright.engine.pipelines.recovery import Dynamics
from cellwright.kb.terms import Function


def test_a_refusal_names_what_does_not_hold_and_nothing_else() -> None:
    dynamics, step = Dynamics(problem_of("themse/one")), Function("open_drawer")
    start = dynamics.start()
    assert dynamics.refusal(step, start) == ""
    opened = dynamics.after(step, start)
    assert (
        dynamics.refusal(step, opened) == "its precondition does not hold: position(drawer, closed)"
    )


def test_a_refusal_names_the_objects_of_the_step() -> None:
    dynamics = Dynamics(problem_of("themse/one"))
    step = Function("pick", (Function("probe_1"), Function("stand")))
    said = dynamics.refusal(step, dynamics.start())
    assert "at(probe_1, stand)" in said
    assert "Item" not in said
