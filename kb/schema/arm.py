"""The form of arm files: joints as a Denavit-Hartenberg table, and the shapes of links."""

from pydantic import Field

from cellwright.kb.schema.form_base import Strict
from cellwright.kb.schema.geometry_forms import Pair, PoseEntry, Quantity, ShapeEntry, UnitsEntry


class DhEntry(Strict):
    """One joint in standard Denavit-Hartenberg form: turn theta about z, move d along z and a
    along x, turn alpha about x.
    """

    a: Quantity = Field("0", description="length along x")
    alpha: Quantity = Field("0", description="angle about x")
    d: Quantity = Field("0", description="length along z")
    theta: Quantity = Field("0", description="angle about z at joint value 0")
    lower: Quantity | None = Field(None, description="the least value; no limit if left out")
    upper: Quantity | None = Field(None, description="the greatest value; no limit if left out")
    speed: Quantity | None = Field(None, description="greatest speed, per second")
    acceleration: Quantity | None = Field(
        None, description="greatest acceleration, per second squared"
    )


class LinkEntry(PoseEntry):
    """A rigid link."""

    carrier: str = Field(
        pattern=r"^[0-9]{1,2}$", description="the number of joints that move it; 0 for the base"
    )
    shapes: list[ShapeEntry] = Field(
        default_factory=list, description="the shapes that can collide"
    )


class ArmFile(Strict):
    """An arm: its joints as a Denavit-Hartenberg table, and the shapes of its links."""

    arm: str = Field(pattern=r"^[a-z][a-z0-9_]*$", description="the arm's name")
    units: UnitsEntry = Field(
        default_factory=lambda: UnitsEntry(length="m", angle="deg"),
        description="the units of numbers without a unit",
    )
    dh: list[DhEntry] = Field(min_length=1, description="one entry for each joint, from the base")
    links: dict[str, LinkEntry] = Field(default_factory=dict, description="name: link")
    allowed_contacts: list[Pair] = Field(
        default_factory=list, description="pairs of links that may touch or can never touch"
    )
    assumptions: list[str] = Field(
        default_factory=list, description="values that are assumed because they are not published"
    )
