"""The general algorithm yields ITA's figure 4 from the five-step plan."""

from collections.abc import Iterable

from macro_cells import bundled, figure_4

from cellwright.kb.model.plan_model import Macrop


def texts(parts: Iterable[object]) -> set[str]:
    return {str(part) for part in parts}


def assert_body_of_figure_4(macrop: Macrop) -> None:
    """All that the figure lists but its n-ary constraints."""
    assert str(macrop.name) == "measured(Id1, Tool1, Arm1, Id2)"
    assert texts(macrop.goals) == {"measured(Tool1, Arm1, meas(Id2))"}
    assert texts(macrop.preconditions) == {
        "at(Arm1, in_contact_point(meas(Id1)))",
        "holding(Arm1, Tool1)",
    }
    assert texts(macrop.adders) == {
        "at(Arm1, in_contact_point(meas(Id2)))",
        "measured(Tool1, Arm1, meas(Id2))",
    }
    assert texts(macrop.resources) == {"Tool1", "Arm1"}
    assert [(step.id, str(step.operator), step.after) for step in macrop.steps] == [
        (1, "move_retract(Arm1, Id1)", ()),
        (2, "move(Arm1, meas(Id1), meas(Id2))", (1,)),
        (3, "apply_couplant(Arm1, Id2)", (2,)),
        (4, "move_contact(Arm1, Id2)", (3,)),
        (5, "us_measure(Tool1, Arm1, Id2)", (4,)),
    ]


def test_the_papers_operators_give_figure_4_and_nothing_more() -> None:
    found = figure_4()
    macrop = found.learned.macrop
    assert_body_of_figure_4(macrop)
    assert texts(macrop.unary_constraints(found.problem.domain)) == {"Tool1: us_tool", "Arm1: arm"}
    assert [str(part) for part in macrop.constraints] == [
        "can_lift(Arm1, W1)",
        "weight(Tool1, W2)",
        "W2 <= W1",
    ]
    assert macrop.disequalities == ()
    assert macrop.exclusions == ()


def test_the_bundled_cell_gives_figure_4_with_the_constraints_that_its_operators_have_beside_the_papers() -> (
    None
):
    found = bundled("bulkhead/one_point")
    macrop = found.learned.macrop
    assert_body_of_figure_4(macrop)
    assert texts(macrop.unary_constraints(found.problem.domain)) == {"Tool1: us_tool", "Arm1: arm"}
    own = {
        "needs(Id2, thickness)",
        "suitable(Tool1, Id2)",
        "visited(meas(Id1))",
        "anywhere(meas(Id2))",
    }
    assert (
        texts(macrop.constraints) == {"can_lift(Arm1, W1)", "weight(Tool1, W2)", "W2 <= W1"} | own
    )
    assert texts(macrop.disequalities) == {"Id1 != Id2"}
    assert macrop.exclusions == ()
    assert (macrop.cost, macrop.duration) == (5, None)  # a move lasts as long as its way
