"""The gauging cell: the probe is calibrated before it is due, by count and by use, and couplant is refilled before it runs out."""

from dataclasses import replace

import pytest

from engine.model.outcome import Found
from engine.pipelines.objective import plan
from kb.loader import load_problem
from kb.model.problem import Problem
from kb.terms import Function, Number

LIMITS = {"values_since": 25, "seconds_since": 400}


def begun(problem: Problem, **levels: int) -> Problem:
    """The problem with other amounts at the start."""
    initial = (
        Function(
            atom.name, (*atom.arguments[:-1], Number(levels.get(atom.name, int(str(atom.arguments[-1])))))
        )
        if atom.name in ("couplant", *LIMITS)
        else atom
        for atom in problem.initial
    )
    return replace(problem, initial=tuple(initial))


@pytest.mark.parametrize(
    ("levels", "calibrations", "refills"),
    [
        ({}, 2, 1),
        ({"couplant": 40, "values_since": 0, "seconds_since": 0}, 1, 0),
        ({"couplant": 40, "values_since": 0, "seconds_since": 398}, 2, 0),
        ({"couplant": 0, "values_since": 25, "seconds_since": 100}, 2, 1),
    ],
)
def test_what_is_due_is_planned_before_the_measurements_that_need_it(
    levels: dict[str, int], calibrations: int, refills: int
) -> None:
    problem = begun(load_problem("gauging/wall"), **levels)
    found = plan(problem).outcome
    assert isinstance(found, Found)
    amounts = {atom.name: int(str(atom.arguments[-1])) for atom in problem.initial if atom.name != "at"}
    done = [step.operator.name for step in found.plan.steps]
    for name in done:
        if name == "calibrate":
            amounts |= {"values_since": 0, "seconds_since": 0}
        elif name == "refill":
            amounts["couplant"] = 40
        elif name == "wet":
            amounts["couplant"] -= 1
        elif name == "gauge":
            amounts["values_since"] += 1
            amounts["seconds_since"] += 4
        assert amounts["couplant"] >= 0
        assert all(amounts[each] <= most for each, most in LIMITS.items())
    assert (done.count("gauge"), done.count("calibrate"), done.count("refill")) == (30, calibrations, refills)
