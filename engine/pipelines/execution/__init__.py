"""Execution of a plan through a driver: watched, kept in a journal, carried on after exceptions.

The core is `cellwright.engine.stages.execution`, a table without a clock. Here are the loop that
waits, the exception handler, and what a person can do at a pause.
"""

from typing import TYPE_CHECKING

from cellwright.kb.doorways import open_doorway

if TYPE_CHECKING:
    from cellwright.engine.model.run_protocol import Finish as Finish
    from cellwright.engine.pipelines.execution.cell_rest import REST_MS as REST_MS
    from cellwright.engine.pipelines.execution.cell_rest import (
        halt_open_drivers as halt_open_drivers,
    )
    from cellwright.engine.pipelines.execution.compiled_program import ReplyLimits as ReplyLimits
    from cellwright.engine.pipelines.execution.controllers.conformance import (
        check_conformance as check_conformance,
    )
    from cellwright.engine.pipelines.execution.controllers.reference_controller import (
        serve_controller as serve_controller,
    )
    from cellwright.engine.pipelines.execution.executable_plan import ReadyPlan as ReadyPlan
    from cellwright.engine.pipelines.execution.executable_plan import first_plan as first_plan
    from cellwright.engine.pipelines.execution.learned_durations import (
        learn_durations as learn_durations,
    )
    from cellwright.engine.pipelines.execution.learned_durations import (
        with_learned_durations as with_learned_durations,
    )
    from cellwright.engine.pipelines.execution.operator_orders import GivenOrder as GivenOrder
    from cellwright.engine.pipelines.execution.operator_orders import OrderSource as OrderSource
    from cellwright.engine.pipelines.execution.operator_orders import TimedOrders as TimedOrders
    from cellwright.engine.pipelines.execution.plan_records import (
        read_ground_atom as read_ground_atom,
    )
    from cellwright.engine.pipelines.execution.run_control import RunExecution as RunExecution
    from cellwright.engine.pipelines.execution.run_goals import RunScope as RunScope
    from cellwright.engine.pipelines.execution.run_motions import RunPaths as RunPaths
    from cellwright.engine.pipelines.execution.run_motions import going_home as going_home
    from cellwright.engine.pipelines.execution.run_results import results_of as results_of
    from cellwright.engine.pipelines.execution.run_results import runs_in as runs_in
    from cellwright.engine.pipelines.execution.run_results import survey_of as survey_of
    from cellwright.engine.pipelines.execution.run_socket import (
        REFUSABLE_ORDERS as REFUSABLE_ORDERS,
    )
    from cellwright.engine.pipelines.execution.run_socket import OrderChannel as OrderChannel
    from cellwright.engine.pipelines.execution.run_socket import tell_run as tell_run
    from cellwright.engine.pipelines.execution.run_start import RunRequest as RunRequest
    from cellwright.engine.pipelines.execution.run_start import begin_run as begin_run
    from cellwright.engine.pipelines.execution.run_start import follow_run as follow_run
    from cellwright.engine.pipelines.execution.run_start import list_run as list_run
    from cellwright.engine.pipelines.execution.run_start import name_run as name_run
    from cellwright.engine.pipelines.execution.run_start import resume_run as resume_run
else:
    __getattr__ = open_doorway(
        __name__,
        {
            "cellwright.engine.model.run_protocol": ("Finish",),
            ".controllers.conformance": ("check_conformance",),
            ".controllers.reference_controller": ("serve_controller",),
            ".executable_plan": (
                "ReadyPlan",
                "first_plan",
            ),
            ".compiled_program": ("ReplyLimits",),
            ".cell_rest": (
                "REST_MS",
                "halt_open_drivers",
            ),
            ".learned_durations": (
                "learn_durations",
                "with_learned_durations",
            ),
            ".operator_orders": (
                "GivenOrder",
                "OrderSource",
                "TimedOrders",
            ),
            ".plan_records": ("read_ground_atom",),
            ".run_control": ("RunExecution",),
            ".run_goals": ("RunScope",),
            ".run_motions": (
                "RunPaths",
                "going_home",
            ),
            ".run_results": (
                "results_of",
                "runs_in",
                "survey_of",
            ),
            ".run_socket": (
                "OrderChannel",
                "REFUSABLE_ORDERS",
                "tell_run",
            ),
            ".run_start": (
                "RunRequest",
                "begin_run",
                "follow_run",
                "list_run",
                "name_run",
                "resume_run",
            ),
        },
    )
