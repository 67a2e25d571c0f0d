"""Which kinds of unified-planning problems the engine takes; all others are refused by feature."""

from collections.abc import Iterable

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
# of problems with durations or timed effects
TIMED_FEATURES = (
    *(feature for feature in UP_FEATURES if "OBJECT" not in feature and "COST" not in feature),
    "CONTINUOUS_TIME",
    "DISCRETE_TIME",
    "TIMED_EFFECTS",
    "DURATION_INEQUALITIES",
    "SELF_OVERLAPPING",
    "STATIC_FLUENTS_IN_DURATIONS",
    "FLUENTS_IN_DURATIONS",
    "INT_TYPE_DURATIONS",
    "REAL_TYPE_DURATIONS",
    "SIMPLE_NUMERIC_PLANNING",
    "GENERAL_NUMERIC_PLANNING",
    "CONTINUOUS_NUMBERS",
    "DISCRETE_NUMBERS",
    "INCREASE_EFFECTS",
    "DECREASE_EFFECTS",
    "STATIC_FLUENTS_IN_NUMERIC_ASSIGNMENTS",
    "FLUENTS_IN_NUMERIC_ASSIGNMENTS",
    "INT_FLUENTS",
    "REAL_FLUENTS",
    "NUMERIC_FLUENTS",
    "MAKESPAN",
    "UNDEFINED_INITIAL_NUMERIC",
)
SUPPORTED_KIND = ProblemKind(UP_FEATURES, version=LATEST_PROBLEM_KIND_VERSION)
TIMED_KIND = ProblemKind(TIMED_FEATURES, version=LATEST_PROBLEM_KIND_VERSION)


def refuse_other_kinds(problem: AbstractProblem, known: Iterable[str] = UP_FEATURES) -> None:
    """Raises `Unsupported` with every feature of a problem that is not `known`.

    The library only warns of them.
    """
    if further := sorted(set(problem.kind.features).difference(known)):
        raise Unsupported(", ".join(feature.lower().replace("_", " ") for feature in further))
