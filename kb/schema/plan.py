"""The form of a plan file, which `cellwright plan --format json` writes and `cellwright
validate` reads.
"""

from typing import Any

from pydantic import BaseModel, ConfigDict, Field

from cellwright.kb.schema.problem import ProblemFile


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class StepEntry(_Strict):
    """One operator instance."""

    id: int = Field(gt=0, description="positive and unique; 0 is the initial state, -1 the goal")
    operator: str = Field(description="an operator instance, such as move(arm, a, b)")
    after: list[int] = Field(
        default_factory=list, description="steps that must have ended before this one starts"
    )
    resources: list[str] = Field(
        default_factory=list, description="what the step holds while it lasts"
    )
    duration: int = Field(0, ge=0, description="in the domain's unit of time")
    cost: int = Field(1, ge=0, description="what the step adds to the cost of the plan")
    start: int | None = Field(
        None,
        description="when the step starts, in the domain's unit of time; not before the steps in "
        "`after` have ended",
    )


class LinkEntry(_Strict):
    """A causal link: `producer` makes `condition` true for `consumer`."""

    producer: int = Field(description="a step, or 0 for the initial state")
    condition: str = Field(description="an atom, or not(atom)")
    consumer: int = Field(description="a step, or -1 for the goal")


class PlanEntry(_Strict):
    """A partially ordered plan and the problem that it solves."""

    problem: ProblemFile = Field(
        description="the problem that the plan solves, as in a problem file"
    )
    steps: list[StepEntry] = Field(description="the steps, each after the steps that it waits for")
    links: list[LinkEntry] = Field(default_factory=list, description="the reasons for each step")
    cost: int | None = Field(None, description="the sum of the steps' costs; computed")
    makespan: int | None = Field(
        None,
        description="the end of the last step if each step starts as early as possible; computed",
    )
    histories: list[dict[str, Any]] = Field(
        default_factory=list, description="what was done to each object; computed"
    )


class AnswerData(BaseModel):
    """The data of an answer. Only the plan in it is read back."""

    model_config = ConfigDict(extra="ignore", frozen=True)

    plan: PlanEntry = Field(description="the plan; the other data of an answer is not read back")


class PlanFile(BaseModel):
    """The envelope of an answer that holds a plan."""

    model_config = ConfigDict(extra="ignore", frozen=True)

    version: int = Field(description="the version of the envelope: 1")
    status: str = Field("", description="how the search ended; not read back")
    data: AnswerData = Field(description="the answer itself")
