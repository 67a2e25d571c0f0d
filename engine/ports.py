"""The replaceable parts of the engine, as Protocols. `engine.plugins` finds who fills them."""

from typing import Protocol

from engine.model.geometry import Contact, Floats, Scene, Truths


class CollisionChecker(Protocol):
    """A scene made ready for questions.

    `where` is a batch of configurations (n, k) of the scene's joints or, for a free scene, of poses (n, 4, 4) of its
    moving carrier in the world. Answers do not depend on how questions are batched. Nothing is known about a configuration
    or pose with an entry that is no finite number: it counts as a collision, with a clearance of minus infinity. `ValueError`
    is raised for an array of another shape, and by `contacts` also for what is no number.
    """

    @property
    def scene(self) -> Scene:
        """What is checked."""
        ...

    def collides(self, where: Floats) -> Truths:
        """Whether any pair of the scene touches or overlaps, for each of the batch (n,)."""
        ...

    def clearance(self, where: Floats, beyond_m: float = 1.0) -> Floats:
        """The least signed distance over all pairs (n,), at most `beyond_m`; negative: the greatest depth."""
        ...

    def contacts(self, where: Floats, within_m: float = 0.0) -> tuple[Contact, ...]:
        """For one configuration (k,) or pose (4, 4): every pair of bodies nearer than `within_m`, nearest first.

        Of two bodies made of several pieces the nearest (or deepest) pieces are told.
        """
        ...


class GeometryBackend(Protocol):
    """Who computes distances and collisions."""

    @property
    def name(self) -> str:
        """How a person asks for it."""
        ...

    @property
    def exact_depths(self) -> bool:
        """Whether a depth is the least displacement that parts two bodies; if not, it is a local estimate of it."""
        ...

    def checker(self, scene: Scene) -> CollisionChecker:
        """Make a scene ready. Raises `ValueError` when the backend cannot represent it."""
        ...
