"""Contacts that can only be made or only be broken: regions of states, fused tokens."""

from pathlib import Path

import pytest

from cellwright.engine.model.outcome import Found
from cellwright.engine.pipelines import contact_states
from cellwright.engine.pipelines.planning import checked_plan
from cellwright.kb.loader import load

CELLS = Path(__file__).parents[3] / "domains"


def test_a_satellite_is_assembled_one_way() -> None:
    model, _ = contact_states.contact_model_of(str(CELLS / "satellite"))
    net = contact_states.build_net(model)
    assert sum(each.states for each in net.regions) == net.growth.states == 112
    assert [each.exits for each in net.regions] == [1, 1, 1, 0]
    assert net.regions[0].fused == ("cover - bus (tape)",) or net.regions[0].fused == ()
    assert net.regions[-1].fused.count("module - bus (snap)") == 2
    one_way = {each.operator for each in net.transitions if not each.reversible}
    assert one_way == {"snap_in", "tear_off"}


def test_tokens_that_are_fused_stay_in_one_cluster() -> None:
    model, _ = contact_states.contact_model_of(str(CELLS / "assembly"))
    net = contact_states.build_net(model)
    assert len(net.regions) == 2
    assert net.regions[1].fused == ("cap - housing (press)",)
    tokens = {name for name, _ in net.places[0].capacity}
    assert tokens == {"arm"}
    assert not any(each.operator == "part" for each in net.transitions)


def test_a_cell_for_which_nobody_wrote_operators_is_planned() -> None:
    target = str(CELLS / "satellite")
    assert load(CELLS / "satellite" / "domain.yaml").domain.operators == ()
    goals = ", ".join(f"contact(module_latch(module_{n}), bus_bay(bus, bay_{n}))" for n in (1, 2))
    outcome = checked_plan.plan_problem(checked_plan.problem_of(target, goals))
    assert isinstance(outcome, Found)
    assert len(outcome.plan.steps) == 10


@pytest.mark.slow
def test_two_arms_assemble() -> None:
    goals = (
        "contact(gear_shaft(gear), housing_bore(housing)), contact(cap_edge(cap), "
        "housing_rim(housing))"
    )
    outcome = checked_plan.plan_problem(checked_plan.problem_of(str(CELLS / "assembly"), goals))
    assert isinstance(outcome, Found)
