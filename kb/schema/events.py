"""The form of the lines that `cellwright run --events` writes: one event a line.

Readers pass over keys that they do not know.
"""

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, RootModel

Pairs = list[tuple[str, float]]
Number = Annotated[int | None, Field(description="the number of a command, or null")]
Atoms = Annotated[list[str], Field(description="ground atoms")]


class _Event(BaseModel):
    """What every event has."""

    model_config = ConfigDict(extra="allow", frozen=True)

    version: Literal[1] = Field(description="the version of this form")
    run: str = Field(description="the name of the run")
    number: int = Field(ge=1, description="events count from 1 without gaps")
    at_ms: int = Field(ge=0, description="milliseconds on the run's clock since it began")


class RunEvent(_Event):
    """A run begins."""

    kind: Literal["run"] = Field(description="what happened")
    target: str = Field(description="the problem, as it was named")
    problem: str = Field(description="the name of the problem")
    domain: str = Field(description="the name of the domain")
    driver: str = Field(description="who carries the commands out")
    seed: int = Field(description="of the simulation and the searches")
    options: dict[str, str] = Field(description="of the driver")


class PlannedStep(BaseModel):
    """A step of a plan and its forecast. Keys that say nothing are left out."""

    model_config = ConfigDict(extra="allow", frozen=True)

    id: int = Field(description="the number of the step in the plan")
    step: str = Field(description="an operator instance")
    stream: str = Field(description="the device that carries it out")
    after: list[int] = Field(
        default_factory=list, description="steps that must have ended before it starts"
    )
    resources: list[str] = Field(default_factory=list, description="what it holds while it lasts")
    start_ms: int = Field(0, description="the forecast of its start")
    lasts_ms: int = Field(0, description="how long it lasts")


class PlanEvent(_Event):
    """A plan, which replaces all steps that have not begun."""

    kind: Literal["plan"] = Field(description="what happened")
    why: str = Field(
        description="first, recovery, reschedule, choice, aligned (the part was found elsewhere), "
        "again "
        "(values are doubtful or undecided), or the order that asked for it"
    )
    steps: list[PlannedStep] = Field(description="its steps")
    forecast_ms: int = Field(description="the forecast of its end")
    goals: list[str] = Field(description="what it is for")
    hands: list[str] = Field(default_factory=list, description="the resources that work as hands")
    full: list[str] = Field(default_factory=list, description="the hands that hold something")
    ahead: list[tuple[int, int, int, int]] = Field(
        default_factory=list,
        description="the next steps as far as their starts can be forecast: the number of the "
        "step, "
        "its "
        "start, and the two "
        "times between which it begins with 95 %",
    )


class CommandEvent(_Event):
    """A command is about to be sent."""

    kind: Literal["command"] = Field(description="what happened")
    command: int = Field(description="its number, which ascends")
    command_kind: str = Field(description="step, test, repair, ask, wait or continue")
    stream: str = Field(description="the device")
    action: str = Field(description="the step, test or repair")
    step: int | None = Field(None, description="the number of the step in the plan, if it is one")
    lasts_ms: int = Field(description="the forecast")
    timeout_ms: int | None = Field(None, description="when it is given up")
    looks: list[str] = Field(
        default_factory=list, description="facts that the device looks at first"
    )
    watches: list[str] = Field(
        default_factory=list, description="facts that it looks at until the step ends"
    )
    part: list[float] = Field(
        default_factory=list,
        description="where the part lies: three rows of a displacement of its model, in metres",
    )


class ReplyEvent(_Event):
    """A reply has come, or none within the time: then its text is `timeout`."""

    kind: Literal["reply"] = Field(description="what happened")
    command: int = Field(description="the command that it answers")
    text: str = Field(description="a term, such as done or value(812)")
    data: dict[str, Any] = Field(default_factory=dict, description="what is too much for a term")


class TroubleEvent(_Event):
    """Something is wrong with the connection to the controller."""

    kind: Literal["trouble"] = Field(description="what happened")
    trouble: str = Field(description="lost, garbage, repeated, strange, late or clock")
    text: str = Field(description="what it was")
    command: Number = None


class DoneEvent(_Event):
    """A step is done, and the world model follows."""

    kind: Literal["done"] = Field(description="what happened")
    step: int = Field(description="its number in the plan")
    command: int = Field(description="the command that did it")
    action: str = Field(description="the operator instance")
    started_ms: int = Field(description="when it began")
    adds: Atoms = Field(description="what holds now")
    ends: Atoms = Field(description="what held before and holds no more")
    events: Atoms = Field(default_factory=list, description="what has happened by it")


class ResultEvent(_Event):
    """A reply gave a fact, or a measured value."""

    kind: Literal["result"] = Field(description="what happened")
    command: int = Field(description="the command that was answered")
    action: str = Field(description="the operator instance")
    result: str = Field(description="the fact; empty if it gave none")
    of: str | None = Field(None, description="what was measured, if something was")
    quantity: str | None = Field(None, description="which quantity of it")
    value: float | None = Field(None, description="the measured value")
    unit: str | None = Field(None, description="what the numbers count")
    nominal: float | None = Field(None, description="what the value should be, if that is known")
    lower: float | None = Field(None, description="the least value that passes")
    upper: float | None = Field(None, description="the greatest value that passes")
    uncertainty: float | None = Field(
        None, description="of the value: two standard deviations, if that is known"
    )
    risk: float | None = Field(
        None, description="how many percent of the decisions may be wrong, if that is said"
    )
    passed: bool | None = Field(None, description="the verdict; null if nobody said what passes")
    tool: str | None = Field(None, description="the tool that measured")


class ExceptionEvent(_Event):
    """A step failed, or something threatens to."""

    kind: Literal["exception"] = Field(description="what happened")
    exception: str = Field(description="its name in the fault base, else the reply")
    known: bool = Field(True, description="whether the fault base knows it")
    action: str = Field(description="the operator instance")
    command: Number = None
    reply: str = Field(description="what came instead of a normal reply")


class FindingEvent(_Event):
    """A test, a repair or a question had an outcome."""

    kind: Literal["finding"] = Field(description="what happened")
    exception: str = Field(description="what is being diagnosed")
    action: str = Field(description="the test, repair or question")
    outcome: str = Field(description="what it gave")
    belief: Pairs = Field(description="causes and their probabilities before it")


class DiagnosisEvent(_Event):
    """A diagnosis has ended."""

    kind: Literal["diagnosis"] = Field(description="what happened")
    exception: str = Field(description="what was diagnosed")
    causes: Pairs = Field(description="causes and their probabilities")
    cured: str | bool = Field(description="the repair that has helped; empty or false if none has")
    isolated: bool = Field(description="whether the cause is known")
    cost: float = Field(description="what tests and repairs have cost")


class WorldEvent(_Event):
    """The world model was corrected."""

    kind: Literal["world"] = Field(description="what happened")
    why: str = Field(description="the reason")
    adds: Atoms = Field(description="what holds")
    ends: Atoms = Field(description="what does not hold")


class GivenUpEvent(_Event):
    """A goal was given up."""

    kind: Literal["given_up"] = Field(description="what happened")
    goal: str = Field(description="the goal")
    why: str = Field(description="the reason")


class GoalEvent(_Event):
    """A stage or a goal was reached."""

    kind: Literal["goal"] = Field(description="what happened")
    goal: str = Field(description="the goal")


class AlignmentEvent(_Event):
    """It was found out where the part lies, or that it fits nowhere."""

    kind: Literal["alignment"] = Field(description="what happened")
    part: list[float] = Field(
        description="three rows of a displacement of its model, in metres; empty: it fits nowhere"
    )
    centre: list[float] = Field(
        default_factory=list, description="the middle of the datums, in metres"
    )
    covariance: list[list[float]] = Field(
        default_factory=list,
        description="of a shift and a turn about the centre: metres and radians",
    )
    datums: int = Field(0, description="how many datums agree")
    wrong: list[str] = Field(default_factory=list, description="the datums that disagree")
    why: str = Field("", description="why it fits nowhere")


class OrderEvent(_Event):
    """A person or another program told the run something."""

    kind: Literal["order"] = Field(description="what happened")
    order: str = Field(description="stop, interrupt, continue, ...")
    given: str = Field("", description="what it said besides")
    origin: str = Field(description="terminal or socket")
    who: str = Field("", description="who gave it, if that is known")
    when: str = Field("", description="date and time (UTC) when it came, if that is known")


class DecisionEvent(_Event):
    """The executive chose between alternatives."""

    kind: Literal["decision"] = Field(description="what happened")
    what: str = Field(description="what was decided")
    why: str = Field(description="the reason")


class PhaseEvent(_Event):
    """The executive does something else now."""

    kind: Literal["phase"] = Field(description="what happened")
    phase: str = Field(
        description="ready, running, interrupting, quiescing, handling, paused, finished, stopped"
    )
    why: str = Field("", description="the reason")


class CheckpointEvent(_Event):
    """From here a run can be resumed without what was before."""

    kind: Literal["checkpoint"] = Field(description="what happened")


class EndEvent(_Event):
    """The run has ended."""

    kind: Literal["end"] = Field(description="what happened")
    outcome: str = Field(description="reached, partly, stopped, aborted or paused")
    why: str = Field("", description="the reason")
    goals: list[str] = Field(description="the goals that are reached")
    open_goals: list[str] = Field(description="the goals that are not")
    given_up: list[tuple[str, str]] = Field(description="goals that were given up, and why")
    makespan_ms: int = Field(description="when the run ended")


AnyEvent = Annotated[
    RunEvent | PlanEvent | CommandEvent | ReplyEvent | TroubleEvent | DoneEvent | ResultEvent
    | ExceptionEvent | FindingEvent | DiagnosisEvent | WorldEvent | GivenUpEvent | GoalEvent
    | OrderEvent | DecisionEvent
    | PhaseEvent | CheckpointEvent | EndEvent | AlignmentEvent,
    Field(discriminator="kind"),
]  # fmt: skip


class EventLine(RootModel[AnyEvent]):
    """One line of the event stream."""
