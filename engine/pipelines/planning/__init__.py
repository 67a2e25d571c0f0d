"""Planning."""

from typing import TYPE_CHECKING

from cellwright.kb.doorways import open_doorway

if TYPE_CHECKING:
    from cellwright.engine.pipelines.planning.checked_plan import check_plan as check_plan
    from cellwright.engine.pipelines.planning.checked_plan import plan_in as plan_in
    from cellwright.engine.pipelines.planning.decomposition import (
        SharedMeasurements as SharedMeasurements,
    )
    from cellwright.engine.pipelines.planning.decomposition import by_sequence as by_sequence
    from cellwright.engine.pipelines.planning.decomposition import shares_of as shares_of
    from cellwright.engine.pipelines.planning.decomposition.kept_sequences import (
        carry_on as carry_on,
    )
    from cellwright.engine.pipelines.planning.decomposition.kept_sequences import (
        told_of_losses as told_of_losses,
    )
    from cellwright.engine.pipelines.planning.library_plans import (
        plan_with_library as plan_with_library,
    )
    from cellwright.engine.pipelines.planning.macros.macro_exchange import (
        learn_from_file as learn_from_file,
    )
    from cellwright.engine.pipelines.planning.macros.macro_exchange import (
        macro_records as macro_records,
    )
    from cellwright.engine.pipelines.planning.macros.macro_exchange import (
        read_macros as read_macros,
    )
    from cellwright.engine.pipelines.planning.macros.macro_exchange import (
        write_macros as write_macros,
    )
    from cellwright.engine.pipelines.planning.plan_files import claimed_in as claimed_in
    from cellwright.engine.pipelines.planning.plan_files import unmet_times as unmet_times
    from cellwright.engine.pipelines.planning.plan_gate import PlanGate as PlanGate
    from cellwright.engine.pipelines.planning.plan_objective import Run as Run
    from cellwright.engine.pipelines.planning.plan_objective import plan_fastest as plan_fastest
    from cellwright.engine.pipelines.planning.plan_objective import (
        plan_for_objective as plan_for_objective,
    )
    from cellwright.engine.pipelines.planning.robustness.robust_run import (
        make_robust as make_robust,
    )
    from cellwright.engine.pipelines.planning.target_files import initial_facts as initial_facts
    from cellwright.engine.pipelines.planning.target_files import load_target as load_target
    from cellwright.engine.pipelines.planning.target_files import problem_of as problem_of
    from cellwright.engine.pipelines.planning.timetable import make_timetable as make_timetable
    from cellwright.engine.pipelines.planning.timetable import subject_of as subject_of
    from cellwright.engine.pipelines.planning.timetable.flowing import by_flow as by_flow
    from cellwright.engine.pipelines.planning.timetable.kept_order import (
        MAX_SCHEDULED_STEPS as MAX_SCHEDULED_STEPS,
    )
    from cellwright.engine.pipelines.planning.timetable.kept_order import (
        SCOPE_KEPT_ORDER as SCOPE_KEPT_ORDER,
    )
else:
    __getattr__ = open_doorway(
        __name__,
        {
            ".checked_plan": (
                "check_plan",
                "plan_in",
            ),
            ".decomposition": (
                "SharedMeasurements",
                "by_sequence",
                "shares_of",
            ),
            ".decomposition.kept_sequences": (
                "carry_on",
                "told_of_losses",
            ),
            ".library_plans": ("plan_with_library",),
            ".macros.macro_exchange": (
                "learn_from_file",
                "macro_records",
                "read_macros",
                "write_macros",
            ),
            ".plan_files": (
                "claimed_in",
                "unmet_times",
            ),
            ".plan_gate": ("PlanGate",),
            ".plan_objective": (
                "Run",
                "plan_fastest",
                "plan_for_objective",
            ),
            ".robustness.robust_run": ("make_robust",),
            ".target_files": (
                "initial_facts",
                "load_target",
                "problem_of",
            ),
            ".timetable": (
                "make_timetable",
                "subject_of",
            ),
            ".timetable.flowing": ("by_flow",),
            ".timetable.kept_order": (
                "MAX_SCHEDULED_STEPS",
                "SCOPE_KEPT_ORDER",
            ),
        },
        libraries={".target_files": ("cellwright.kb.schema.domain", "cellwright.kb.syntax")},
    )
