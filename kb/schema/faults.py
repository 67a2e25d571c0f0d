"""The form of a fault base, `faults.yaml`."""

from typing import Annotated

from pydantic import Field

from cellwright.kb.schema.form_base import Expression, Strict, Truth, WholeNumber

Cost = Annotated[WholeNumber, Field(ge=0, description="its cost, in units of the domain's time")]
Say = Annotated[str, Field(description="a description for people, in a few words")]
Chance = Annotated[
    str, Field(pattern=r"^[0-9](\.[0-9]{1,6})?$", description="a probability, such as 0.95")
]
Repeats = Annotated[
    WholeNumber,
    Field(
        ge=1,
        le=20,
        description="how often it can be done with independent outcomes; 1 if it gives the same "
        "outcome "
        "whenever it is repeated",
    ),
]
Duration = Annotated[
    WholeNumber | None,
    Field(description="its duration, in units of the domain's time; equal to its cost if left out"),
]
Needs = Annotated[
    Expression | None, Field(description="what must hold before; the planner makes it true")
]
Step = Annotated[Expression | None, Field(description="the step of the domain that carries it out")]
Asks = Annotated[Truth, Field(description="a person is asked to do it")]


class ExceptionEntry(Strict):
    """An exception: how it is recognised, and its possible causes."""

    say: Say = ""
    of: Expression | None = Field(
        None, description="the operator that is interrupted: us_measure(Tool, Arm, Id)"
    )
    reply: str = Field(
        "timeout",
        description="the exceptional reply; `timeout` if no reply comes, `outcome_unknown` "
        "if nobody knows how the step ended",
    )
    causes: dict[str, WholeNumber] = Field(
        min_length=1, description="cause: how often it was the cause of this exception"
    )


class CauseEntry(Strict):
    """A fault and its effects on the world model."""

    say: Say = ""
    doubts: Expression | None = Field(
        None, description="assertions that are uncertain while this cause is possible"
    )
    adds: Expression | None = Field(None, description="facts that hold if it is the cause")
    denies: Expression | None = Field(None, description="facts that do not hold if it is the cause")
    loses: list[Expression] = Field(
        default_factory=list, description="objects that can no longer be used"
    )
    completes: Truth = Field(
        False, description="the interrupted step has done what it should: only its reply is wrong"
    )
    blocks: list[Expression] | None = Field(
        None,
        description="steps that fail while the cause is there: us_measure(_, _, Id), or an "
        "operator "
        "alone; if left out, "
        "none for a cause that says what it changes, else the interrupted operator",
    )
    spoils: Expression | None = Field(
        None,
        description="what earlier steps achieved of these facts and events is open again if it is "
        "the "
        "cause",
    )
    since: list[Expression] = Field(
        default_factory=list,
        description="steps after which the cause was surely not there: `spoils` goes back to them",
    )
    stops: Truth = Field(
        False, description="nothing in the cell can repair it: stop safely and ask a person"
    )


class _ActionEntry(Strict):
    say: Say = ""
    cost: Cost
    duration: Duration = None
    preconditions: Needs = None
    by: Step = None
    asks: Asks = False


class TestEntry(_ActionEntry):
    """A test: its cost and its outcomes."""

    outcomes: list[str] = Field(min_length=2, max_length=8, description="the possible outcomes")
    otherwise: str = Field(description="the outcome for causes that `gives` does not name")
    gives: dict[str, str] = Field(
        description="cause: outcome; or outcomes with probabilities, as in `weak 0.9`; the rest "
        "goes "
        "to "
        "`otherwise`"
    )
    repeats: Repeats = 1


class RepairEntry(_ActionEntry):
    """A repair: its cost and the causes that it cures."""

    cures: list[str] | dict[str, Chance] = Field(
        description="causes; or cause: probability that it helps"
    )
    adds: Expression | None = Field(None, description="facts that hold afterwards")
    denies: Expression | None = Field(None, description="facts that do not hold afterwards")
    loses: list[Expression] = Field(
        default_factory=list,
        description="objects that stay lost: the repair is to go on without them",
    )


class FaultsFile(Strict):
    """A `faults.yaml` beside a domain: exceptions, causes, tests and repairs."""

    faults: str = Field(description="the name of the domain beside this file")
    smoothing: Chance = Field(
        "1", description="a number added to every count, so that causes not seen yet stay possible"
    )
    lies: Chance = Field("0.01", description="the probability that an observation is wrong")
    stop: Cost = 600
    exceptions: dict[str, ExceptionEntry] = Field(
        min_length=1, description="events that stop a plan"
    )
    causes: dict[str, CauseEntry | None] = Field(min_length=1, description="possible causes")
    tests: dict[str, TestEntry] = Field(
        default_factory=dict, description="tests that distinguish causes"
    )
    repairs: dict[str, RepairEntry] = Field(
        default_factory=dict, description="repairs that cure causes"
    )
