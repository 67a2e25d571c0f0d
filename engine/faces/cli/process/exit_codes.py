"""Exit codes of the command line (docs/command-line.md)."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from cellwright.engine.model.outcome import Outcome

FINDINGS, BAD_INPUT, INFEASIBLE, GAVE_UP, LIMIT, STOPPED, INTERNAL, INTERRUPTED = (
    1,
    2,
    10,
    12,
    23,
    40,
    70,
    130,
)


def exit_code(outcome: "Outcome") -> int:
    """0 an answer, 10 proven infeasible, 12 gave up, 23 stopped by a limit of time or memory."""
    from cellwright.engine.model.outcome import Found, GaveUp, Infeasible

    match outcome:
        case Found():
            return 0
        case Infeasible():
            return INFEASIBLE
        case GaveUp(limit=limit):
            return GAVE_UP if limit == "expansions" else LIMIT
