"""Which kinds of unified-planning problems the engine takes; all others are refused by feature."""

from unified_planning.model import AbstractProblem, ProblemKind
from unified_planning.model.problem_kind_versioning import LATEST_PROBLEM_KIND_VERSION

from cellwright.engine.formats.interop.up.up_conditions import Unsupported

UP_FEATURES = (
    "ACTION_BASED",
    "FLAT_TYPING",
    "HIERARCHICAL_TYPING",
    "NEGATIVE_CONDITIONS",
    "DISJUNCTIVE_CONDITIONS",
    "EQUALITIES",
    "EXISTENTIAL_CONDITIONS",
    "UNIVERSAL_CONDITIONS",
    "CONDITIONAL_EFFECTS",
    "FORALL_EFFECTS",
    "STATIC_FLUENTS_IN_BOOLEAN_ASSIGNMENTS",
    "FLUENTS_IN_BOOLEAN_ASSIGNMENTS",
    "OBJECT_FLUENTS",
    "STATIC_FLUENTS_IN_OBJECT_ASSIGNMENTS",
    "FLUENTS_IN_OBJECT_ASSIGNMENTS",
    "ACTIONS_COST",
    "STATIC_FLUENTS_IN_ACTIONS_COST",
    "INT_NUMBERS_IN_ACTIONS_COST",
    "REAL_NUMBERS_IN_ACTIONS_COST",
    "PLAN_LENGTH",
)
SUPPORTED_KIND = ProblemKind(UP_FEATURES, version=LATEST_PROBLEM_KIND_VERSION)


def refuse_other_kinds(problem: AbstractProblem) -> None:
    """Raises `Unsupported` with every feature of a problem that is not in `UP_FEATURES`.

    The library only warns of them.
    """
    if further := sorted(set(problem.kind.features).difference(UP_FEATURES)):
        raise Unsupported(", ".join(feature.lower().replace("_", " ") for feature in further))
