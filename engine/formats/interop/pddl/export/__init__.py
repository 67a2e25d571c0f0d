"""PDDL out: a problem of ours as a domain and a problem that any PDDL planner reads, and its plans read back.

The export is lifted: operators keep their parameters, deductive operators become effects, constraints over several
variables become static facts, compound terms become objects, derived predicates are unfolded (recursive ones become
axioms), the workflow becomes counters, and the initial state holds its defaults. What lifted PDDL cannot say (deduction
that leads back to itself, arithmetic inside a disjunction) is exported ground. Durations and resources are left out.
"""

from dataclasses import dataclass

from engine.formats.interop.pddl.export.background import NotLiftable
from engine.formats.interop.pddl.export.flat import flattened
from engine.formats.interop.pddl.export.ground import GroundWriter
from engine.formats.interop.pddl.export.plans import GroundPlans, LiftedPlans
from engine.formats.interop.pddl.export.writer import Writer
from engine.model.task import Task
from kb.model.plan import Plan
from kb.model.problem import Problem


@dataclass(frozen=True, slots=True)
class PddlText:
    """A domain file and a problem file; `why_ground` tells what lifted PDDL could not say, if anything."""

    domain: str
    problem: str
    plans: LiftedPlans | GroundPlans
    why_ground: str = ""

    @property
    def lifted(self) -> bool:
        """Whether operators kept their parameters."""
        return isinstance(self.plans, LiftedPlans)


def export(problem: Problem, task: Task, lifted: bool = True) -> PddlText:
    """A problem as PDDL. `task` is its ground task; `lifted` = False writes that, for planners that read STRIPS alone."""
    why = ""
    if lifted:
        try:
            flat = flattened(problem, task)
            writer = Writer(flat)
            return PddlText(writer.domain(), writer.problem(), LiftedPlans(flat, writer.names, problem, task))
        except NotLiftable as error:
            why = str(error)
    ground = GroundWriter(problem.name, task)
    return PddlText(ground.domain(), ground.problem(), GroundPlans(ground.actions, task), why)


def import_plan(exported: PddlText, text: str, name: str = "plan") -> Plan:
    """A plan that a planner found for an export, as a sequence of our operators. Raises `InvalidInput`."""
    return exported.plans.read(text, name)


def write_plan(exported: PddlText, plan: Plan) -> str:
    """A plan of ours as one for the export: one action a line."""
    return exported.plans.written(plan)
