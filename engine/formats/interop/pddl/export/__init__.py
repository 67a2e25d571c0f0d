"""PDDL out: a problem becomes a domain file and a problem file that any PDDL planner reads; its plans are read back.

The export is lifted: operators keep their parameters, deductive operators become effects, constraints over several
variables become static facts, compound terms become objects, derived predicates are unfolded (recursive ones become
axioms), the workflow becomes counters, and the initial state holds its defaults. If lifted PDDL cannot express a problem
(deduction that leads back to itself, arithmetic inside a disjunction), the ground task is exported.
So is one with quantities, which become numeric fluents. Durations and resources are left out.
"""

from dataclasses import dataclass

from cellwright.engine.formats.interop.pddl.export.background import NotLiftable
from cellwright.engine.formats.interop.pddl.export.flat import flattened
from cellwright.engine.formats.interop.pddl.export.ground import GroundWriter
from cellwright.engine.formats.interop.pddl.export.plans import GroundPlans, LiftedPlans
from cellwright.engine.formats.interop.pddl.export.writer import Writer
from cellwright.engine.model.task import Task
from cellwright.kb.model.plan import Plan
from cellwright.kb.model.problem import Problem


@dataclass(frozen=True, slots=True)
class PddlText:
    """A domain file and a problem file. `why_ground` names what lifted PDDL could not express; it is empty otherwise."""

    domain: str
    problem: str
    plans: LiftedPlans | GroundPlans
    why_ground: str = ""

    @property
    def lifted(self) -> bool:
        """Whether operators kept their parameters."""
        return isinstance(self.plans, LiftedPlans)


def export(problem: Problem, task: Task, lifted: bool = True) -> PddlText:
    """A problem as PDDL. `task` is its ground task; it is written if `lifted` is False, for planners that only read STRIPS."""
    why = "quantities" if problem.domain.quantities else ""
    if lifted and not why:
        try:
            flat = flattened(problem, task)
            writer = Writer(flat)
            return PddlText(writer.domain(), writer.problem(), LiftedPlans(flat, writer.names, problem, task))
        except NotLiftable as error:
            why = str(error)
    ground = GroundWriter(problem.name, task)
    return PddlText(ground.domain(), ground.problem(), GroundPlans(ground.actions, task), why)


def import_plan(exported: PddlText, text: str, name: str = "plan") -> Plan:
    """A plan that another planner found for an export, as a sequence of our operators. Raises `InvalidInput`."""
    return exported.plans.read(text, name)
