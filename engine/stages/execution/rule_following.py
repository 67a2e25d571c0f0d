"""When an activity with a start rule may begin: a policy is followed event by event.

The policy is a dispatchable network: who begins each activity as soon as its rule allows keeps all
windows of the plan, however long activities last within their ranges (Morris 2014).
"""

from cellwright.engine.model.start_rules import StartRule
from cellwright.engine.stages.execution.activity_program import ActivityProgram
from cellwright.engine.stages.execution.run_state import ExecutiveState


def allowed_start(
    program: ActivityProgram, standing: ExecutiveState, rule: StartRule
) -> int | None:
    """The soonest start that a rule allows, as far as is known now; None as long as it waits for
    something that has not happened. Activities of older programs have happened long ago.
    """
    soonest = rule.floor
    for lags, times in ((rule.starts, standing.begun_ms), (rule.ends, standing.ended_ms)):
        for activity, lag in lags.items():
            if activity in times:
                soonest = max(soonest, times[activity] + lag)
            elif activity in program.activities:
                return None
    for activity, time_ms in rule.waits.items():
        if activity in standing.ended_ms or activity not in program.activities:
            continue
        if activity not in standing.begun_ms:
            return None
        soonest = max(soonest, standing.begun_ms[activity] + time_ms)
    return soonest


def is_within_ranges(program: ActivityProgram, standing: ExecutiveState) -> bool:
    """Whether a policy is followed, and nothing under way lasts longer than it counts on."""
    return program.follows_rules and all(
        longest is None or standing.now_ms - running.since_ms <= longest
        for running in standing.running.values()
        for longest in [program.activities[running.activity].longest_ms]
    )
