"""Fault bases: what is read from them, what is refused, and that both bundled ones hold
together.
"""

import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cellwright.kb.check.fault_base_check import check_faults
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.loader import bundled_domains
from cellwright.kb.loader.fault_base import load_faults
from cellwright.kb.model.fault_model import FaultModel
from cellwright.kb.terms import Function, Variable

DOMAIN = """domain: press
types: {plate: object}
objects: {plate: [plate_1]}
fluents:
  placed(plate): {}
operators:
  place(Plate):
    adds: placed(Plate)
"""
FAULTS = """faults: press
exceptions:
  nothing_placed:
    of: place(Plate)
    causes: {stuck: 3, empty: 1}
causes:
  stuck: {doubts: placed(Plate)}
  empty:
tests:
  look: {cost: 5, outcomes: [plate, none], otherwise: plate, gives: {empty: none 0.75}}
repairs:
  shake: {cost: 9, duration: 4, cures: {stuck: 0.5}, by: place(plate_1)}
  refill: {cost: 60, cures: [empty, stuck], asks: true}
"""


def load(folder: Path, faults: str) -> FaultModel:
    (folder / "domain.yaml").write_text(DOMAIN)
    (folder / "faults.yaml").write_text(faults)
    return load_faults(folder / "domain.yaml")[0]


def test_a_fault_base_is_read(tmp_path: Path) -> None:
    model = load(tmp_path, FAULTS)
    exception = model.exceptions["nothing_placed"]
    assert exception.operator == Function("place", (Variable("Plate"),))
    assert exception.reply == "timeout"
    assert model.causes["stuck"].doubts == (Function("placed", (Variable("Plate"),)),)
    assert [repair.name for repair in model.repairs_of("stuck")] == ["refill", "shake"]


def test_what_has_no_duration_takes_what_it_costs(tmp_path: Path) -> None:
    model = load(tmp_path, FAULTS)
    assert [model.duration(name) for name in ("look", "shake", "refill", "question")] == [
        5,
        4,
        60,
        0,
    ]


def test_what_probabilities_leave_goes_to_the_usual_outcome(tmp_path: Path) -> None:
    look = load(tmp_path, FAULTS).tests["look"]
    assert look.gives["empty"] == {"none": 0.75, "plate": 0.25}
    assert look.likelihood("plate", "stuck") == 1.0


def test_priors_are_smoothed_counts(tmp_path: Path) -> None:
    model = load(tmp_path, FAULTS)
    assert model.priors("nothing_placed") == pytest.approx({"stuck": 4 / 6, "empty": 2 / 6})


THEMSE = load_faults(bundled_domains()["themse"] / "domain.yaml")[0]


@given(st.dictionaries(st.sampled_from([*THEMSE.causes, "other"]), st.integers(0, 1000)))
def test_priors_sum_to_one_whatever_was_counted(counts: dict[str, int]) -> None:
    for exception in THEMSE.exceptions:
        assert math.fsum(THEMSE.priors(exception, counts).values()) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("was", "becomes", "code"),
    [
        ("{stuck: 3, empty: 1}", "{stuck: 3, emtpy: 1}", "K101"),
        ("of: place(Plate)", "of: place(Plate, Plate)", "K102"),
        ("of: place(Plate)", "of: plaice(Plate)", "K101"),
        ("doubts: placed(Plate)", 'doubts: "placed(Plate, Plate)"', "K102"),
        ("doubts: placed(Plate)", "doubts: plate(Plate)", "K108"),
        ("none 0.75", "nine 0.75", "K101"),
        ("none 0.75", "none 75%", "K901"),
        ("otherwise: plate", "otherwise: bowl", "K101"),
        ("cost: 5", "costs: 5", "K005"),
        ("cost: 5", "cost: five", "K005"),
        ("cures: {stuck: 0.5}", "cures: {stuck: 1.5}", "K901"),
        ("faults: press", "faults: pres", "K101"),
    ],
)
def test_what_is_wrong_is_said(tmp_path: Path, was: str, becomes: str, code: str) -> None:
    with pytest.raises(InvalidInput) as raised:
        load(tmp_path, FAULTS.replace(was, becomes, 1))
    assert {each.code for each in raised.value.diagnostics} == {code}


def test_a_domain_without_a_fault_base_is_told_so(tmp_path: Path) -> None:
    (tmp_path / "domain.yaml").write_text(DOMAIN)
    with pytest.raises(InvalidInput, match="K405"):
        load_faults(tmp_path / "domain.yaml")


@pytest.mark.parametrize("domain", ["bulkhead", "themse"])
def test_a_bundled_fault_base_is_large_and_sound(domain: str) -> None:
    model, warnings = load_faults(bundled_domains()[domain] / "domain.yaml")
    assert not warnings
    assert check_faults(model) == []
    assert len(model.causes) >= 12
    assert len(model.tests) >= 12
    assert not any(model.alike(exception) for exception in model.exceptions)
