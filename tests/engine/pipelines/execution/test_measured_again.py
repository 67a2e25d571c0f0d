"""What is measured again in a run, and by which tool: the one that is worth it, after a drift
was found, until the part is known well enough.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cellwright.engine.model.run_protocol import Finish, RecordKind
from cellwright.engine.model.verdicts import MeasuredFeature, Survey
from cellwright.engine.pipelines.execution import RunRequest, TimedOrders, begin_run, name_run
from cellwright.engine.pipelines.execution.remeasurement import reopen_measurements
from cellwright.engine.pipelines.execution.run_results import survey_of
from cellwright.engine.pipelines.simulators.true_part import (
    DriftingTools,
    displacement_of,
    drift_of,
    read_truth,
)
from cellwright.kb.asp import ground_term
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.loader import load, load_problem
from cellwright.kb.model.conditions import goal_parts
from cellwright.kb.terms import Function
from tests.engine.pipelines.execution.test_inspected_runs import TRUE, job, lines_of
from tests.places import BUNDLED

DRIFT = {
    "per_value": 2.5,
    "calibrated_by": "calibrate",
    "allowance": 30,
    "cause": "calibration_lost",
}


def carried_out(
    folder: Path, target: str, truth: dict[str, Any], seed: int = 1
) -> tuple[Finish, Survey]:
    file, store = folder / "truth.json", str(folder / "runs.db")
    file.write_text(json.dumps(truth))
    problem = load_problem(target)
    wanted = RunRequest(target, store=store, run="one", seed=seed, options={"truth": str(file)})
    ending = begin_run(name_run(wanted, problem), problem, TimedOrders())
    assert isinstance(ending, Finish)
    survey = survey_of(store, "one").survey
    assert survey is not None
    return ending, survey


def features(survey: Survey) -> dict[str, MeasuredFeature]:
    return {each.of: each for each in survey.features}


def walled(**others: float) -> dict[str, Any]:
    values = {f"w{n}": others.get(f"w{n}", 8000.0 + 5 * n) for n in range(1, 9)}
    return {"values": values, "noise": {"probe": 10, "fine_probe": 2.5}}


def test_a_goal_that_any_tool_may_reach_is_opened_for_the_one_that_is_named() -> None:
    problem = load_problem("gauging/two_probes")
    again = reopen_measurements(problem, {"w6": "fine_probe", "w2": ""}, ())
    assert sorted(str(each).replace(" ", "") for each in goal_parts(again.goal)) == [
        "measured(_,_,meas(w2))",
        "measured(fine_probe,_,meas(w6))",
    ]


def test_what_stays_undecided_is_measured_by_the_other_tool_where_that_is_worth_it(
    tmp_path: Path,
) -> None:
    ending, survey = carried_out(tmp_path, "gauging/two_probes", walled(w3=7858.0, w6=7858.0))
    assert ending.outcome == "reached"
    tools = {name: [one.tool for one in each.values] for name, each in features(survey).items()}
    other = [name for name, each in tools.items() if "fine_probe" in each]
    assert other
    assert set(other) <= {"w3", "w6"}
    told = features(survey)[other[0]]
    assert told.judged == "conforming"
    assert any("a value of fine_probe decides with" in why for why in told.again)
    assert any("undecided with fine_probe" in line and "takes" in line for line in ending.story)


@pytest.mark.slow
def test_the_other_tool_stays_in_the_rack_where_its_exchange_costs_more_than_a_decision(
    tmp_path: Path,
) -> None:
    lines = (BUNDLED / "gauging" / "problems" / "two_probes.yaml").read_text().splitlines()
    far = [each.replace("domain: gauging", f"domain: {tmp_path / 'gauging'}") for each in lines]
    (tmp_path / "gauging").mkdir()
    for each in (BUNDLED / "gauging").iterdir():
        if each.is_file():
            text = each.read_text().replace("duration: 20 s", "duration: 20 min")
            (tmp_path / "gauging" / each.name).write_text(text)
    target = tmp_path / "far.yaml"
    target.write_text("\n".join(far) + "\n")
    ending, survey = carried_out(tmp_path, str(target), walled(w3=7858.0, w6=7858.0))
    assert ending.outcome == "reached"
    assert {one.tool for each in survey.features for one in each.values} == {"probe"}


@pytest.mark.slow
def test_a_drift_that_a_calibration_finds_puts_the_values_since_the_last_one_in_doubt(
    tmp_path: Path,
) -> None:
    truth = {
        "values": {f"p{n}": 8000.0 for n in range(1, 31)},
        "noise": {"probe": 5},
        "drift": {"probe": {**DRIFT, "values": 29}},
    }
    ending, survey = carried_out(tmp_path, "gauging/wall", truth)
    assert (ending.outcome, ending.exceptions) == ("reached", 1)
    assert "calibration_lost" in ending.story[0]
    spoilt = [each for each in survey.features if any("drift_found" in why for _, why in each.bad)]
    lines = [
        each for each in lines_of(str(tmp_path / "runs.db")) if each.kind == RecordKind.WORLD.value
    ]
    (found,) = [each for each in lines if each.content.get("spoils")]
    assert (
        len(spoilt) == len(found.content["spoils"]) == 25
    )  # the four before the calibration in between stand
    assert set(survey.counts()) == {"conforming"}
    late = [one for each in survey.features for one in each.values]
    assert all(abs(one.value - 8000.0) <= 30 for one in late)
    assert all(one.at_ms > found.at_ms for each in spoilt for one in each.values)


@pytest.mark.slow
def test_a_drift_within_the_allowance_is_corrected_and_nothing_is_in_doubt(tmp_path: Path) -> None:
    truth = {"noise": {"probe": 5}, "drift": {"probe": {**DRIFT, "per_value": 1.0}}}
    ending, survey = carried_out(tmp_path, "gauging/wall", truth)
    assert (ending.outcome, ending.exceptions) == ("reached", 0)
    assert not any(why for each in survey.features for _, why in each.bad if "drift_found" in why)


def test_a_drifting_tool_is_farther_off_with_each_value_until_it_is_calibrated() -> None:
    drift = drift_of({**DRIFT, "values": 3})
    assert not isinstance(drift, str)
    tools, calibrate = DriftingTools({"probe": drift}), ground_term("calibrate(robot, probe)")
    assert isinstance(calibrate, Function)
    assert [tools.measured("probe") for _ in range(5)] == [0.0, 2.5, 5.0, 7.5, 7.5]
    assert tools.measured("other") == 0.0
    assert tools.found(calibrate) is None
    tools.now["probe"] = 31.0
    assert tools.found(calibrate) == "calibration_lost"
    tools.calibrated(calibrate)
    assert tools.measured("probe") == 0.0


@pytest.mark.parametrize(
    ("drift", "said"),
    [
        ([], "`drift` does not say of each tool how it drifts"),
        ({"probe": 3}, "`drift` of probe: needs per_value, calibrated_by, allowance and cause"),
        ({"probe": {**DRIFT, "allowance": -1}}, "allowance is negative"),
        ({"probe": {**DRIFT, "per_value": "much"}}, "per_value is no number"),
        ({"probe": {**DRIFT, "calibrated_by": "calibrat"}}, "unknown operator 'calibrat'"),
    ],
)
def test_a_drift_that_means_nothing_is_refused(tmp_path: Path, drift: object, said: str) -> None:
    file = tmp_path / "truth.json"
    file.write_text(json.dumps({"drift": drift}))
    with pytest.raises(InvalidInput) as caught:
        read_truth(str(file), load_problem("gauging/wall"), 0)
    assert said in str(caught.value)


def demanding(folder: Path, within_um: int) -> str:
    target = job(folder, {})
    demand = f"statics:\n  - aligned_within({within_um})\n"
    target.write_text(target.read_text().replace("statics:\n", demand))
    return str(target)


@pytest.mark.slow
def test_datums_are_measured_again_until_the_part_is_known_well_enough(tmp_path: Path) -> None:
    target = demanding(tmp_path, 35)
    ending, survey = carried_out(
        tmp_path, target, json.loads((tmp_path / "truth.json").read_text())
    )
    assert ending.outcome == "reached"
    assert any("and has to be to 0.035 mm" in each for each in ending.story)
    kinds = [each.kind for each in lines_of(str(tmp_path / "runs.db"))]
    assert kinds.count(RecordKind.ALIGNMENT.value) == 1
    problem = load(Path(target)).problem
    assert problem is not None
    off = displacement_of(survey.part) @ np.linalg.inv(TRUE) - np.eye(4)
    assert np.abs(off[:3, 3]).max() < 5e-5


def test_a_demand_that_the_datums_cannot_meet_is_refused_before_anything_else_is_measured(
    tmp_path: Path,
) -> None:
    target = demanding(tmp_path, 4)
    ending, survey = carried_out(
        tmp_path, target, json.loads((tmp_path / "truth.json").read_text())
    )
    assert ending.outcome == "partly"
    assert "12 values of each datum are not enough" in ending.why
    assert "has to be to 0.004 mm" in survey.refused
    assert all(each.of.startswith("d") for each in survey.features)
