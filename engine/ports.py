"""The replaceable parts of the engine, as Protocols. `engine.plugins` finds their implementations."""

from collections.abc import Sequence
from typing import Protocol

from engine.kernels.geometry.edges import Edges
from engine.kernels.geometry.proof import Proof
from engine.model.geometry import Contact, Floats, Scene, Truths
from kb.model.octuples import Octuple


class CollisionChecker(Protocol):
    """Answers questions about collisions and distances in one scene.

    `where` is a batch of configurations (n, k) of the scene's joints. For a free scene it is a batch of poses
    (n, 4, 4) of the moving carrier in the world. The batch size does not change the answers. A configuration or
    pose with an entry that is not a finite number counts as a collision, with a clearance of minus infinity,
    because nothing is known about it. Raises `ValueError` for an array of another shape; `contacts` also raises
    it for entries that are not finite.
    """

    @property
    def scene(self) -> Scene:
        """The scene that is checked."""
        ...

    def collides(self, where: Floats) -> Truths:
        """Whether any pair of bodies touches or overlaps, for each element of the batch (n,)."""
        ...

    def clearance(self, where: Floats, beyond_m: float = 1.0) -> Floats:
        """The least signed distance over all pairs (n,), in metres, at most `beyond_m`.

        A negative value is a penetration, by the greatest depth over all pairs.
        """
        ...

    def contacts(self, where: Floats, within_m: float = 0.0) -> tuple[Contact, ...]:
        """The pairs of bodies nearer than `within_m` at one configuration (k,) or pose (4, 4), nearest first.

        If a body consists of several pieces, the contact is that of its nearest (or deepest) piece.
        """
        ...


class MotionGround(CollisionChecker, Protocol):
    """A checker that motions are planned on. It has joints: its scene is not free."""

    def lines(self, step: float, margin_m: float = 0.0) -> Edges:
        """The straight lines between configurations, each checked whole in one call, every `step` (rad, m).

        What comes within `margin_m` of another thing touches it.
        """
        ...

    def proof(self, margin_m: float, finest_m: float) -> Proof:
        """What proves that nothing comes within `margin_m` anywhere on a path, by stretches of motions down to `finest_m`."""
        ...

    def covered(self, wrist: Sequence[int], start: Floats, goal: Floats) -> "MotionGround":
        """The ground where one box stands for all that the joints `wrist` carry.

        It covers them at all their values between two configurations (k,). It moves with what the first of them stands on.
        """
        ...

    def travel(self, first: Floats, second: Floats) -> float:
        """A bound on the way (m) of every point of everything that moves, on the straight line between configurations (k,)."""
        ...


class Hand(Protocol):
    """The hand of the arm that moves, for planners that think in the room. Configurations are those of the ground (n, k)."""

    def poses(self, q: Floats) -> Floats:
        """The poses of the tool, or of the tip of what is in hand, in the world (n, 4, 4)."""
        ...

    def reaching(self, poses: Floats, near: Floats) -> list[Floats]:
        """For each pose (n, 4, 4) the configurations (m, k) within the limits that reach it, those nearest to `near` (k,) first."""
        ...

    def boxes(self) -> tuple[Floats, Floats]:
        """The boxes around what stands in the cell: their poses in the world (n, 4, 4), and half their edges (n, 3) in m."""
        ...


class GeometryBackend(Protocol):
    """A library that computes distances and collisions."""

    @property
    def name(self) -> str:
        """The name by which users choose the backend."""
        ...

    @property
    def exact_depths(self) -> bool:
        """Whether depths are exact: the least displacement that separates two bodies.

        If not, they are local estimates.
        """
        ...

    def checker(self, scene: Scene) -> CollisionChecker:
        """The checker for a scene. Raises `ValueError` when the backend cannot represent the scene."""
        ...


class ContactFilter(Protocol):
    """Says which contact states of a cell are infeasible or unwanted. It is made for one `ContactModel`.

    It is asked about one cluster at a time, with one object for all that are alike. What it says must not depend on which
    of them it is, nor on which of several alike anchor points, except for those that it names in `individuals`.
    """

    def individuals(self) -> frozenset[tuple[str, str]]:
        """The anchor points (object class, anchor point) that are not exchangeable for this filter."""
        ...

    def reason(self, objects: Sequence[str], contacts: Sequence[Octuple], change: Octuple | None) -> str:
        """Why a cluster of objects with these contacts cannot be; empty if it can.

        `change` is the contact that is made; None if one is broken, or if nothing changes.
        """
        ...
