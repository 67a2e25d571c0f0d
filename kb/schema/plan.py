"""The shape of a plan file: what `cellwright plan --format json` writes and `cellwright validate` reads."""

from typing import Any

from pydantic import BaseModel, ConfigDict, Field

from kb.schema.problem import ProblemFile


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class StepEntry(_Strict):
    """One operator instance."""

    id: int = Field(gt=0, description="positive and unique; 0 is the initial state, -1 the goal")
    operator: str = Field(description="an operator instance, such as move(arm, a, b)")
    after: list[int] = Field(
        default_factory=list, description="steps that must have ended before this one starts"
    )
    resources: list[str] = Field(default_factory=list, description="what the step holds while it lasts")
    duration: int = Field(0, ge=0, description="in the domain's unit of time")
    cost: int = Field(1, ge=0, description="what the step adds to the cost of the plan")
    start: int | None = Field(
        None, description="earliest start, in the domain's unit of time; derived, not read back"
    )


class LinkEntry(_Strict):
    """A causal link: `producer` makes `condition` true for `consumer`."""

    producer: int = Field(description="a step, or 0 for the initial state")
    condition: str = Field(description="an atom, or not(atom)")
    consumer: int = Field(description="a step, or -1 for the goal")


class PlanEntry(_Strict):
    """A partially ordered plan and the problem that it solves."""

    problem: ProblemFile = Field(description="the problem that the plan solves, as in a problem file")
    steps: list[StepEntry] = Field(description="every step after those it waits for")
    links: list[LinkEntry] = Field(default_factory=list, description="why each step is there")
    cost: int | None = Field(None, description="sum of the steps' costs; derived")
    makespan: int | None = Field(
        None, description="end of the last step when each starts as early as it may; derived"
    )
    histories: list[dict[str, Any]] = Field(
        default_factory=list, description="what was done to each object; derived"
    )


class AnswerData(BaseModel):
    """What an answer carries beside the plan is not read back."""

    model_config = ConfigDict(extra="ignore", frozen=True)

    plan: PlanEntry = Field(description="the plan; what else an answer holds is not read back")


class PlanFile(BaseModel):
    """The envelope of an answer that holds a plan."""

    model_config = ConfigDict(extra="ignore", frozen=True)

    version: int = Field(description="of the envelope; 1")
    status: str = Field("", description="how the search ended; not read back")
    data: AnswerData = Field(description="the answer itself")
