#!/usr/bin/env bash
# Field: temporal planning, unified-planning (Python). Date: 2026-11-29. Version: unified-planning 1.3.0.
# Guess: the validator of time-triggered plans refuses a step whose condition over all is false from its start to its end.
# Seen: VALID, where no effect happens at the start of the step nor while it lasts. The states that are looked at are those
# of happenings after the start; the state that holds at the start is left out where no happening is exactly there.
# With any effect at the start of the step the same plan is INVALID. (PDDL 2.1: a condition over all holds at every point
# between the two ends.)
# So "the library's validator accepts it" proves little for invariants. Ours looks at the state after each start.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check 'unified-planning==1.3.0' 2>/dev/null
"$folder/venv/bin/python" - <<'PYTHON'
import sys
from fractions import Fraction
from importlib.metadata import version

from unified_planning.engines.plan_validator import TimeTriggeredPlanValidator
from unified_planning.plans import TimeTriggeredPlan
from unified_planning.shortcuts import *

print("unified-planning", version("unified-planning"))


def verdict(with_start: bool) -> str:
    door, loaded, busy = Fluent("door_open"), Fluent("loaded"), Fluent("busy")
    load = DurativeAction("load")
    load.set_fixed_duration(3)
    load.add_condition(OpenTimeInterval(StartTiming(), EndTiming()), door)
    load.add_effect(EndTiming(), loaded, True)
    if with_start:
        load.add_effect(StartTiming(), busy, True)
    problem = Problem("hatch")
    for fluent in (door, loaded, busy):
        problem.add_fluent(fluent, default_initial_value=False)
    problem.add_action(load)
    problem.add_goal(loaded)
    plan = TimeTriggeredPlan([(Fraction(1), load(), Fraction(3))])
    return TimeTriggeredPlanValidator().validate(problem, plan).status.name


print("the door is closed all the time, and loading needs it open throughout")
print("expected: INVALID, INVALID")
print("seen:", verdict(False), "without an effect at the start,", verdict(True), "with one")
sys.exit(0 if (verdict(False), verdict(True)) == ("VALID", "INVALID") else 1)
PYTHON
