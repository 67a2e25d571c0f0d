"""All values of a part together: bad ones are left out, dents are kept, and surfaces are judged
where the part lies.
"""

import random

import numpy as np
import pytest

from cellwright.engine.kernels.rigid import rotation_by_vector, transform
from cellwright.engine.model.verdicts import MeasuredFeature
from cellwright.engine.pipelines.inspection.feature_verdicts import assess_features
from cellwright.engine.pipelines.inspection.part_alignment import PartAlignment, displace_problem
from cellwright.engine.pipelines.inspection.remeasurement_worth import chance_of_decision
from cellwright.kb.loader import load
from cellwright.kb.model.measured_results import Conformity, Measured, check_conformity
from cellwright.kb.model.planning_problem import Problem
from tests.places import BUNDLED


@pytest.fixture(scope="module")
def plate(tmp_path_factory: pytest.TempPathFactory) -> Problem:
    """A grid of 36 points on a plate, a tenth of a metre apart."""
    lines = [
        "problem: plate",
        f"domain: {BUNDLED / 'bulkhead'}",
        "objects: {measurement: [m0..m35]}",
        "statics:",
    ]
    for n in range(36):
        lines += [f"  - needs(m{n}, profile)", f"  - normal(m{n}, 0, 0, 1000)"]
        lines += [f"  - position(m{n}, {100_000 * (n % 6)}, {100_000 * (n // 6)}, 0)"]
    file = tmp_path_factory.mktemp("plate") / "plate.yaml"
    file.write_text("\n".join([*lines, "goals: []", ""]))
    found = load(file).problem
    assert found is not None
    return found


def value(name: str, number: float, at_ms: int = 0) -> Measured:
    return Measured(name, "profile", number, "um", 0.0, -100.0, 100.0, "slra", "", at_ms, 20.0, 5.0)


def grid(**others: float) -> list[Measured]:
    chance = random.Random(1)
    return [value(f"m{n}", others.get(f"m{n}", chance.gauss(0, 10))) for n in range(36)]


def found(
    problem: Problem, measured: list[Measured], lying: PartAlignment | None = None
) -> dict[str, MeasuredFeature]:
    return {each.of: each for each in assess_features(problem, measured, lying)}


def test_a_single_value_that_neighbours_do_not_explain_is_in_doubt(plate: Problem) -> None:
    features = found(plate, grid(m14=70.0))
    assert [name for name, each in features.items() if each.doubt] == ["m14"]
    assert features["m14"].conformity is None
    assert features["m14"].judged == "doubtful"


def test_a_repeated_value_tells_a_bad_one(plate: Problem) -> None:
    feature = found(plate, [*grid(m14=70.0), value("m14", 4.0, 9)])["m14"]
    assert (feature.value, feature.doubt) == (4.0, "")
    assert [each.value for each, _ in feature.bad] == [70.0]
    assert feature.conformity is Conformity.CONFORMING


def test_a_dent_that_is_measured_twice_is_no_bad_value(plate: Problem) -> None:
    feature = found(plate, [*grid(m14=-300.0), value("m14", -290.0, 9)])["m14"]
    assert feature.value == -295.0
    assert (feature.bad, feature.doubt) == ((), "")
    assert feature.conformity is Conformity.NOT_CONFORMING


def test_two_values_that_disagree_and_fit_nowhere_stay_in_doubt(plate: Problem) -> None:
    feature = found(plate, [*grid(m14=-300.0), value("m14", 300.0, 9)])["m14"]
    assert feature.doubt == "2 values disagree"


def test_the_mean_of_repeated_values_is_surer(plate: Problem) -> None:
    feature = found(plate, [*grid(m14=3.0), value("m14", 9.0, 9)])["m14"]
    assert feature.value == 6.0
    assert feature.uncertainty == pytest.approx(20.0 / 2**0.5)


def test_without_uncertainties_the_last_value_counts_and_nothing_is_in_doubt(
    plate: Problem,
) -> None:
    measured = [
        Measured(f"m{n}", "profile", 1e4 * n, "um", at_ms=k) for k in (0, 1) for n in range(36)
    ]
    features = found(plate, measured)
    assert [each.value for each in features.values()] == [1e4 * n for n in range(36)]
    assert not any(each.doubt or each.bad for each in features.values())


def test_surfaces_measured_before_the_part_was_found_are_judged_where_it_lies(
    plate: Problem,
) -> None:
    T = transform(
        rotation_by_vector(np.array([0.01, -0.02, 0.03])), np.array([0.001, 0.002, -0.004])
    )
    lying = PartAlignment(T, 100, np.zeros(3), np.eye(6) * 1e-12)
    along = T[:3, :3] @ np.array([0.0, 0.0, 1.0])
    measured = []
    for n in range(36):
        p = np.array([0.1 * (n % 6), 0.1 * (n // 6), 0.0])
        off = along @ (T[:3, :3] @ p + T[:3, 3] - p) / along[2]
        measured.append(value(f"m{n}", 1e6 * off + 5.0 / along[2]))
    features = found(plate, measured, lying)
    assert [each.value for each in features.values()] == pytest.approx([5.0] * 36, abs=1e-6)
    late = found(plate, [value("m0", 5.0, 101)], lying)
    assert late["m0"].value == 5.0


def test_what_is_unsure_about_the_place_does_not_become_surer_by_repeating(plate: Problem) -> None:
    lying = PartAlignment(np.eye(4), 0, np.zeros(3), np.diag([0, 0, 9e-12, 0, 0, 0]))  # 3 um
    feature = found(plate, [value("m0", 0.0, 1) for _ in range(400)], lying)["m0"]
    assert feature.uncertainty == pytest.approx(2 * (9.0 + 100.0 / 400) ** 0.5)


def test_a_displaced_problem_has_its_points_where_the_part_lies(plate: Problem) -> None:
    T = transform(rotation_by_vector(np.array([0.0, 0.0, np.pi / 2])), np.array([0.0, 0.0, 0.01]))
    facts = set(map(str, displace_problem(plate, T).statics))
    assert "position(m1,0,100000,10000)" in {each.replace(" ", "") for each in facts}
    assert len(facts) == len(set(map(str, plate.statics)))


@pytest.mark.parametrize("at", [0.0, 60.0, 85.0, 97.0, 130.0])
def test_the_chance_of_a_decision_is_that_of_many_further_values(at: float) -> None:
    chance, decided, draws = random.Random(3), 0, 4000
    for _ in range(draws):
        true = chance.gauss(at, 10.0)
        mean = (at + chance.gauss(true, 10.0)) / 2
        shown = check_conformity(mean, -100.0, 100.0, 20.0 / 2**0.5)
        decided += shown is not Conformity.UNDECIDED
    feature = MeasuredFeature("m", "profile", "um", 0.0, -100.0, 100.0, 5.0, at, 20.0)
    assert chance_of_decision(feature, 20.0) == pytest.approx(decided / draws, abs=0.03)
