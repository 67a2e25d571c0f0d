"""Ranges of durations that are learned from the journals of runs."""

from pathlib import Path

import pytest

from cellwright.engine.pipelines import execution, planning
from cellwright.engine.pipelines.execution.learned_durations import LearnedDuration, _share_of
from cellwright.kb import loader
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.model.domain_model import VaryingDuration
from cellwright.kb.terms import Number, Operation, Variable
from tests.engine.pipelines.planning.robustness.uncertain_cells import write_oven


def test_ranges_are_learned_from_runs_and_a_plan_reckons_with_them(tmp_path: Path) -> None:
    cell = write_oven(tmp_path, stay=90, heat="70 s", load="10 s")
    problem, store = loader.load_problem(cell), str(tmp_path / "runs.db")
    with pytest.raises(InvalidInput) as refused:
        execution.learn_durations(store, problem)
    assert [d.code for d in refused.value.diagnostics] == ["K421"]
    for seed in range(20):
        request = execution.RunRequest(str(cell), store=store, seed=seed, options={"spread": "0.2"})
        with execution.list_run(request, problem) as wanted:
            execution.begin_run(wanted, problem, execution.TimedOrders([]))
    learned = {each.operator: each for each in execution.learn_durations(store, problem)}
    assert set(learned) == {"load", "heat", "unload"}
    heat = learned["heat"]
    assert heat.steps == 20
    assert 0.79 < heat.least < 0.9 < heat.mean < 1.1 < heat.most < 1.21
    taught = execution.with_learned_durations(problem, learned.values())
    _, robust = planning.make_robust(taught, planning.plan_for_objective(taught))
    assert robust is not None
    assert robust.varying == 3
    assert not robust.is_robust  # heating may last 70 s and a third more


def test_a_duration_of_facts_varies_by_shares_of_it(tmp_path: Path) -> None:
    cell = write_oven(tmp_path, stay=90, heat="70 s", load="10 s")
    problem = loader.load_problem(cell)
    learned = LearnedDuration("heat", 30, 0.9, 1.2, 1.0, 0.02)
    (heat,) = [
        operator
        for operator in execution.with_learned_durations(problem, [learned]).domain.operators
        if operator.name == "heat"
    ]
    assert heat.duration == Number(70)
    assert heat.varies == VaryingDuration(Number(63), Number(84), Number(2))
    assert learned.text == "heat took 90 to 120 % of its forecast in 30 steps"


def test_what_has_no_number_of_its_own_is_a_term() -> None:
    share = _share_of(Variable("N"), 1.2, rounding=round)
    assert share == Operation("/", Operation("*", Variable("N"), Number(1200)), Number(1000))
