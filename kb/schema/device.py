"""The form of `device.yaml`: a part of a domain that other domains use."""

from typing import Annotated, Literal

from pydantic import Field

from cellwright.kb.schema.domain import Sections
from cellwright.kb.schema.form_base import Strict

Meaning = Annotated[str, Field(description="what it means, in a few words")]


class ParameterEntry(Strict):
    """A parameter: what it is, and its value if a use gives none."""

    is_: str = Field(alias="is", description="what it is, with its unit")
    default: str | list[str] | None = Field(
        None, description="its value if a use gives none; else each use must give one"
    )


class ExampleEntry(Strict):
    """What the verb `init` writes for it. `P` stands for a probe."""

    objects: str | None = Field(
        None, description="an object that a problem has to have: `measurement: wall`"
    )
    static: str | None = Field(
        None, description="facts that never change, which a problem has to give"
    )
    initial: str | None = Field(
        None, description="facts that a problem has to give: the levels of bottles"
    )
    stage: str | None = Field(
        None, description="a stage that the device reaches: $heated(P, 10 min)"
    )
    goal: str | None = Field(None, description="a goal that it reaches, in place of a stage")
    probes: Literal["1", "2"] = Field("1", description="how many probes reach it together")
    turn: Literal["1", "2", "3", "4"] = Field(
        "3",
        description="when a probe comes to it: 1 it arrives and is read, 2 it is filled, 4 it is "
        "closed",
    )
    fault: str | None = Field(
        None,
        description="a step and a cause that can be repaired, as for `run --fault`: "
        "$press_switch=switch_not_pressed",
    )


class DeviceFile(Sections):
    """A `device.yaml`: what a device adds to a domain.

    `$name` stands for a parameter, an own name or a port.
    """

    device: str = Field(
        pattern=r"^[a-z][a-z0-9_]*$", description="the device's name, which is that of its folder"
    )
    about: str = Field(description="what it is, in one sentence")
    parameters: dict[str, ParameterEntry] = Field(
        default_factory=dict,
        description="what a use may set: capacities, durations, the place in the cell",
    )
    own: dict[str, Meaning] = Field(
        default_factory=dict,
        description="names that belong to the device alone: objects, operators, events, and the "
        "name "
        "of "
        "the device itself",
    )
    needs: dict[str, Meaning] = Field(
        default_factory=dict, description="ports that another device fills: hand, holder"
    )
    offers: dict[str, str] = Field(
        default_factory=dict,
        description="ports that it fills for others, with the name that stands for it there",
    )
    drives: dict[str, Meaning] = Field(
        default_factory=dict,
        description="for whoever writes its driver: what a command to each stream has to do",
    )
    example: ExampleEntry | None = Field(
        None, description="what the device does in a cell to start from"
    )
