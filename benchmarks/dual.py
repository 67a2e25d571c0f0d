"""Two arms: how much sooner they are done, and whether a delay lets them collide.

    python benchmarks/dual.py [--part bulkhead|delays|physics|themse ...] [--points N] [--runs N]
        [--work FOLDER] [--json FILE]

`bulkhead`: points on the bulkhead, whose halves are in the reach of one arm each, with a common
strip of a fifth of the width. Each arm takes its half column by column, both in the same direction.
The makespan of both is compared with that of one arm that does all, and drives along the rail once
between (20 s, as the domain says). `delays`: problems of the bench, whose steps begin late at
random, by up to 10 s each; both arms are looked at a hundred times as often as the planner of
motions looks. `physics`: a hand-over and a carry in MuJoCo. `themse`: eight probes, with one
gripper and with two, scheduled without motions. Exits with 1 when a bar is missed: 1.7 times as
fast, no collision, 3 mm and 2 degrees.
"""

import argparse
import json
import random
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from benchmarks.delay_rehearsal import (
    NO_LOOKS,
    DelayRehearsal,
    delayed_begins,
)
from cellwright.domains.bulkhead.points import points
from cellwright.engine.model.motion_values import MovedStep
from cellwright.engine.model.outcome import Found
from cellwright.engine.model.planning_choices import SequenceChoice
from cellwright.engine.model.shop_scheduling import Timetable
from cellwright.engine.pipelines.motion.arm_conflicts import ArmEncounters
from cellwright.engine.pipelines.motion.arm_passing import PassingPlan, kept_apart, moments_of
from cellwright.engine.pipelines.motion.moving_plan import MovingRun, plan_moving
from cellwright.engine.pipelines.motion.plan_walk import PlanWalk
from cellwright.engine.pipelines.planning.checked_plan import problem_of
from cellwright.engine.pipelines.planning.plan_gate import PlanGate
from cellwright.engine.pipelines.planning.plan_objective import plan_for_objective
from cellwright.engine.pipelines.planning.timetable import make_timetable
from cellwright.engine.plugins import geometry_backend
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.planning import SearchLimits
from cellwright.kb.loader.cell import cell_of
from cellwright.kb.model.plan_model import Plan, Step, StepId
from cellwright.kb.terms import Function

HALF_M = 1.4  # of the width of what is measured
STRIP_M = 0.28  # of it, on either side of the middle, is reached by both arms: a fifth in all
BASE_M = 0.7  # where the arms stand, on either side of the middle
DRIVE_S = 20
COLUMN_M = 0.12
BARS = {"speedup": 1.7, "least_m": 0.0, "off_m": 0.003, "tilt_deg": 2.0}
TOP = Path(__file__).resolve().parent.parent

DOMAIN = """
domain: halves
units: {{time: s}}
types: {{arm: object, spot: object}}
objects: {{arm: [west, east], spot: [p1..{count}]}}
fluents:
  measured(spot): {{}}
statics:
  of(arm, spot): {{}}
operators:
  measure(Arm, Spot):
    where: of(Arm, Spot)
    adds: measured(Spot)
    resources: Arm
    duration: 10 s
    command: {{stream: "arm(Arm, measure(Spot))", reply: done}}
"""


def main() -> int:
    """Run the parts that are asked for."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--part", nargs="*", default=["bulkhead", "delays", "physics", "themse"])
    parser.add_argument("--points", type=int, default=400)
    parser.add_argument("--runs", type=int, default=1_000)
    parser.add_argument(
        "--work", type=Path, help="a folder that keeps the cells; without it they are not kept"
    )
    parser.add_argument("--json", type=Path)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as lost:
        work = asked.work or Path(lost)
        parts: dict[str, Callable[[], dict[str, Any]]] = {
            "bulkhead": lambda: bulkhead(asked.points, asked.runs, work),
            "delays": lambda: delays(asked.runs),
            "physics": physics,
            "themse": lambda: themse(8, work),
        }
        found = {part: parts[part]() for part in asked.part}
    print(json.dumps(found, indent=1))
    if asked.json:
        asked.json.write_text(json.dumps(found))
    return int(any(missed(each) for each in found.values()))


def missed(found: dict[str, Any]) -> bool:
    """Whether a figure misses its bar."""
    return bool(
        found.get("speedup", 9.0) < BARS["speedup"]
        or found.get("least_m", 1.0) <= BARS["least_m"]
        or found.get("off_m", 0.0) > BARS["off_m"]
        or found.get("tilt_deg", 0.0) > BARS["tilt_deg"]
    )


def bulkhead(count: int, runs: int, work: Path) -> dict[str, Any]:
    """The makespan of two arms and of one, and whether delays let the two collide."""
    target = written(count, work)
    problem, cell, backend = (
        problem_of(str(target), "", ""),
        cell_of(str(target)),
        geometry_backend(),
    )
    began = time.process_time()
    walk = PlanWalk(PlanGate().semantics(problem), cell, backend)
    given = toured(problem_points(target))
    steps = list(walk.steps(given))
    lost = [each for each in steps if not isinstance(each, MovedStep)]
    if lost:
        return {"lost": str(lost[0])}
    moved = [each for each in steps if isinstance(each, MovedStep)]
    found = time.process_time()
    encounters = ArmEncounters(backend)
    shared = kept_apart(walk, given, lasting, encounters, {})
    if isinstance(shared, str):
        return {"blocked": shared}
    times = {step.operator: step.duration for step in shared.plan.steps}
    PlanGate().accepted(replace(problem, durations=times), shared.plan)
    alone = sum(step.duration for step in lasting(given, moved).steps) + DRIVE_S
    looked = rehearsed(walk, shared, encounters, runs)
    return {
        "points": count,
        "one_arm_s": alone,
        "two_arms_s": shared.makespan,
        "bound_s": shared.sharing.lower_bound,
        "speedup": alone / shared.makespan,
        "zones": len(shared.sharing.zones),
        "pairs_that_could_meet": shared.sharing.ordered,
        "pairs_apart": shared.sharing.apart,
        "proved": all(each.proved for each in shared.steps),
        "motions_cpu_s": found - began,
        "passing_cpu_s": time.process_time() - found,
        **looked,
    }


def rehearsed(
    walk: PlanWalk, shared: PassingPlan, encounters: ArmEncounters, runs: int
) -> dict[str, Any]:
    """Delays of up to 10 s for each step, drawn anew in each run."""
    began, drawn, found = time.process_time(), random.Random(1), NO_LOOKS
    rehearsal = DelayRehearsal(moments_of(walk, shared.plan, shared.steps), encounters)
    for _ in range(runs):
        late = {step.id: drawn.uniform(0.0, 10.0) for step in shared.plan.steps}
        starts, last = delayed_begins(shared.plan, shared.steps, 1.0, late)
        found = found.and_also(rehearsal.seen(starts, last, least_m=found.least_m))
    spent = time.process_time() - began
    return {"runs": runs, **asdict(found), "rehearsed_cpu_s": spent}


def written(count: int, work: Path) -> Path:
    """Domain, cell and problem in a folder; the problem file."""
    near = [(x, y) for x, y in points(1_000) if abs(y) <= HALF_M]
    chosen = [near[n * len(near) // count] for n in range(count)]
    work.mkdir(exist_ok=True)
    cell = yaml.safe_load((TOP / "domains/bulkhead/cell.yaml").read_text())
    made = {
        name: body
        for name, body in cell["fixtures"].items()
        if name in ("web", "ribs", "flanges", "jig")
    }
    probe = cell["tools"]["us_probe"]["shapes"]
    arms, tools, allowed, places, facts = {}, {}, [], {}, []
    for arm, side in (("west", -1), ("east", 1)):
        arms[arm] = {
            "model": "t3_746",
            "at": [0, side * BASE_M, 1.2],
            "tool": {"at": [0, 0, 0.38]},
            "home": cell["arms"]["t3_746"]["home"],
        }
        tools[f"{arm}_probe"] = {"in": f"{arm}.flange", "shapes": probe}
        allowed += [[f"{arm}_probe", f"{arm}.hand"], [f"{arm}_probe", f"{arm}.wrist"]]
    for n, (x, y) in enumerate(chosen, 1):
        arm = "west" if y < 0 else "east"
        facts.append(f"of({arm}, p{n})")
        places[f"at(p{n})"] = {
            "arm": arm, "in": "bulkhead", "at": [round(x, 6), round(y, 6), 0], "approach": 0.12, "turns": True, "touches": ["web", "ribs", "flanges"],
        }  # fmt: skip
    text = {
        "cell": "halves", "arms": arms, "frames": cell["frames"], "fixtures": made, "tools": tools, "allowed_contacts": allowed,
        "places": places, "operations": {"measure(Arm, Spot)": {"at": "at(Spot)", "takes": "7 s"}},
    }  # fmt: skip
    (work / "domain.yaml").write_text(DOMAIN.format(count=count))
    (work / "cell.yaml").write_text(json.dumps(text, indent=1))
    goals = [f"measured(p{n})" for n in range(1, count + 1)]
    asked = {"problem": "halves", "domain": "halves", "statics": facts, "goals": goals}
    (work / "problem.yaml").write_text(yaml.safe_dump(asked))
    return work / "problem.yaml"


def problem_points(target: Path) -> dict[str, list[tuple[int, float, float]]]:
    """The points of each arm: number, x and y."""
    cell = yaml.safe_load(target.with_name("cell.yaml").read_text())
    found: dict[str, list[tuple[int, float, float]]] = {"west": [], "east": []}
    for name, place in cell["places"].items():
        found[place["arm"]].append((int(name[4:-1]), place["at"][0], place["at"][1]))
    return found


def toured(of: dict[str, list[tuple[int, float, float]]]) -> Plan:
    """Each arm goes up and down the columns of its half, both in the same direction; step by
    step in turn.
    """
    tours = {arm: sorted(own, key=_along) for arm, own in of.items()}
    steps, last, number = list[Step](), dict[str, StepId](), 0
    for n in range(max(map(len, tours.values()))):
        for arm, own in tours.items():
            if n < len(own):
                number += 1
                operator = Function("measure", (Function(arm), Function(f"p{own[n][0]}")))
                after = (last[arm],) if arm in last else ()
                steps.append(Step(StepId(number), operator, after, (Function(arm),), 10))
                last[arm] = StepId(number)
    return Plan(tuple(steps))


def _along(point: tuple[int, float, float]) -> tuple[int, float]:
    column = int((point[2] + 10.0) / COLUMN_M)
    return column, point[1] if column % 2 else -point[1]


def lasting(plan: Plan, steps: Any) -> Plan:
    """The plan with the times of its motions, in whole seconds."""
    times = {each.step: int(np.ceil(each.seconds - 1e-9)) for each in steps}
    return replace(
        plan, steps=tuple(replace(s, duration=times.get(s.id, s.duration)) for s in plan.steps)
    )


def themse(probes: int, work: Path) -> dict[str, Any]:
    """The makespan of THEMSE with one gripper and with two, as the domain says how long steps
    take; nothing moves.
    """
    found: dict[str, Any] = {"probes": probes}
    for hands in (1, 2):
        target = two_handed(probes, hands, work / f"themse_{hands}")
        made = make_timetable(problem_of(str(target), "", ""))
        if not isinstance(made, Timetable):
            return {**found, "lost": str(made)}
        key = "one_arm" if hands == 1 else "two_arms"
        schedule = made.schedule
        found |= {
            f"{key}_s": schedule.makespan,
            f"{key}_bound_s": schedule.lower_bound,
            f"{key}_gap": schedule.gap,
        }
    return {**found, "times_as_fast": found["one_arm_s"] / found["two_arms_s"]}


def two_handed(probes: int, hands: int, work: Path) -> Path:
    """THEMSE with so many probes, depots and grippers, in a folder; the problem file. It has no
    sensors.

    Its devices are copied: what the one hand does in them, any hand does.
    """
    for name in ("drawer", "freezer", "furnace", "gripper"):
        handed(TOP / "domains/devices" / name, work / "devices" / name)
    domain = yaml.safe_load((TOP / "domains/themse/domain.yaml").read_text())
    del domain["commands"]
    names = ["mars_gripper", "second_gripper"][:hands]
    domain["objects"] |= {"gripper": names, "probe": [f"probe_1..{probes}"]}
    (work / "domain.yaml").write_text(json.dumps(domain, indent=1))
    (work / "rules.lp").write_text((TOP / "domains/themse/rules.lp").read_text())
    stages = {
        "for": {"P": [f"probe_1..{probes}"]},
        "stages": "heated(P, 15 min), cooled(P, 5 min), stored(P)",
    }
    statics = [f"capacity(drawer, {probes})", "capacity(furnace, 1)", "capacity(freezer, 1)"]
    statics += [f"own_depot(probe_{n}, slot(drawer, {n}))" for n in range(5, probes + 1)]
    asked = {"problem": "probes", "domain": "themse", "statics": statics, "workflow": [stages]}
    (work / "problem.yaml").write_text(json.dumps(asked, indent=1))
    return work / "problem.yaml"


def handed(device: Path, to: Path) -> None:
    """A copy of a device in which each operator of the hand has the hand as its first argument,
    and which has no sensors.
    """
    to.mkdir(parents=True, exist_ok=True)
    text = yaml.safe_load((device / "device.yaml").read_text())
    for section in ("derived", "events") if text["device"] == "gripper" else ():
        del text[section]
    operators = {}
    for name, each in text["operators"].items():
        if name.startswith("$sense"):
            continue
        if "$hand" in json.dumps(each):
            head, _, rest = name.partition("(")
            name = f"{head}(Hand, {rest}" if rest else f"{head}(Hand)"
            each = {
                **json.loads(json.dumps(each).replace("$hand", "Hand")),
                "types": {"Hand": "gripper"},
            }
            each["command"] = {"stream": f"arm({name})", "reply": "done"}
        operators[name] = each
    text["operators"] = operators
    text.pop("commands", None)
    (to / "device.yaml").write_text(json.dumps(text, indent=1))
    rules = (device / "rules.lp").read_text().splitlines()
    (to / "rules.lp").write_text(
        "\n".join(each for each in rules if not each.startswith("shows(")) + "\n"
    )


def moving(name: str) -> tuple[MovingRun, PlanWalk]:
    """The plan that moves for a problem of the bench, and who walks through it."""
    target, backend = f"dual/{name}", geometry_backend()
    problem, cell = problem_of(target, "", ""), cell_of(target)
    made = plan_moving(
        problem,
        cell,
        backend,
        lambda p: plan_for_objective(p, SearchLimits(), None, SequenceChoice.SEQUENCE),
    )
    return made, PlanWalk(PlanGate().semantics(problem), cell, backend)


def delays(runs: int) -> dict[str, Any]:
    """The problems of the bench in turn, with delays."""
    names = ("crossing", "both_sides", "bench", "scanned")
    moments, looks, least = 0, 0, 1.0
    for name in names:
        made, walk = moving(name)
        assert isinstance(made.run.outcome, Found)
        assert made.sharing is not None
        shared = PassingPlan(made.run.outcome.plan, {}, made.steps, made.sharing)
        found = rehearsed(walk, shared, ArmEncounters(geometry_backend()), runs // len(names))
        moments, looks = moments + found["moments"], looks + found["looks"]
        least = min(least, found["least_m"])
    return {"problems": names, "runs": runs, "moments": moments, "looks": looks, "least_m": least}


def physics() -> dict[str, Any]:
    """How far parts are from where the facts put them, and how far they are turned: after each
    step, in the hand, too.
    """
    from cellwright.engine.pipelines.motion.plan_walk import states_of
    from cellwright.engine.pipelines.simulators.mujoco_replay.mujoco_stage import (
        REST_TIME_S,
        MujocoStage,
    )
    from cellwright.engine.stages.geometry.world.geometric_world import (
        GeometricWorld,
        world_after_facts,
    )

    off, tilt, touched, ends = 0.0, 0.0, [], {}
    for name, part in (("over", "rod_1"), ("carried", "beam")):
        made, walk = moving(name)
        assert isinstance(made.run.outcome, Found)
        steps = {each.step: each for each in made.steps}
        stage = MujocoStage(
            world_after_facts(GeometricWorld.of(walk.cell), walk.semantics.initial())
        )
        for step, before, after in states_of(walk.semantics, made.run.outcome.plan):
            worlds = (
                world_after_facts(GeometricWorld.of(walk.cell), before),
                world_after_facts(GeometricWorld.of(walk.cell), after),
            )
            stage.take(steps[step.id], *worlds)
            wanted = stage.actual(worlds[1]).pose("world", part)
            real = stage.pose(part)
            off = max(off, float(np.linalg.norm(wanted[:3, 3] - real[:3, 3])))
            turn = transforms.rotation_vector(wanted[:3, :3].T @ real[:3, :3])
            tilt = max(tilt, float(np.degrees(np.linalg.norm(turn))))
        stage.wait(REST_TIME_S)
        ends[name] = stage.off(worlds[1])[part]
        touched += [
            f"{name}: {each.first} and {each.second}, {each.force_n} N"
            for each in stage.touches.found
        ]
    return {"off_m": off, "tilt_deg": tilt, "touched": touched, "off_in_the_end_m": ends}


if __name__ == "__main__":
    sys.exit(main())
