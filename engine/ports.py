"""The replaceable parts of the engine, as Protocols.

`cellwright.engine.plugins` finds their implementations.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol, runtime_checkable

from cellwright.engine.kernels.arrays import Floats, Truths
from cellwright.engine.model.geometry import CollisionScene, Contact

if TYPE_CHECKING:
    from cellwright.engine.kernels.geometry.edges import Edges
    from cellwright.engine.kernels.geometry.proof import Proof
    from cellwright.engine.model.run_protocol import DriverCommand, Message, Report
    from cellwright.kb.model.contact_model import Octuple
    from cellwright.kb.model.planning_problem import Problem


class CollisionChecker(Protocol):
    """Answers questions about collisions and distances in one scene.

    `where` is a batch of configurations (n, k) of the scene's joints. For a free scene it is a
    batch of poses (n, 4, 4) of the moving carrier in the world. The batch size does not change the
    answers. A configuration or pose with an entry that is not a finite number counts as a
    collision, with a clearance of minus infinity, because nothing is known about it. Raises
    `ValueError` for an array of another shape; `contacts` also raises it for entries that are not
    finite.
    """

    @property
    def scene(self) -> CollisionScene:
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
        """The pairs of bodies nearer than `within_m` at one configuration (k,) or pose (4, 4),
        nearest first.

        If a body consists of several pieces, the contact is that of its nearest (or deepest) piece.
        """
        ...


class MotionScene(CollisionChecker, Protocol):
    """A checker that motions are planned on. It has joints: its scene is not free."""

    def lines(self, step: float, margin_m: float = 0.0) -> "Edges":
        """The straight lines between configurations, each checked whole in one call, every `step`
        (rad, m).

        What comes within `margin_m` of another thing touches it.
        """
        ...

    def proof(self, margin_m: float, finest_m: float) -> "Proof":
        """What proves that nothing comes within `margin_m` anywhere on a path, by stretches of
        motions down to `finest_m`.
        """
        ...

    def covered(self, wrist: Sequence[int], start: Floats, goal: Floats) -> "MotionScene":
        """The ground where one box stands for all that the joints `wrist` carry.

        It covers them at all their values between two configurations (k,). It moves with what the
        first of them stands on.
        """
        ...

    def changing(self, moving: Collection[int]) -> tuple[frozenset[int], ...]:
        """For each pair of the scene, which of the moving joints change how far apart it is;
        none if that is not known.
        """
        ...

    def only(self, rows: Sequence[int]) -> "MotionScene":
        """The ground of some pairs of the scene, given by their numbers. All else is left out."""
        ...

    def changed_since(self, before: "MotionScene") -> "MotionScene | None":
        """The ground on which nothing is checked but the pairs that only one of this ground and
        another has.

        None if their joints differ, so that everything has changed.
        """
        ...

    def travel(self, first: Floats, second: Floats) -> float:
        """A bound on the way (m) of every point of everything that moves, on the straight line
        between configurations (k,).
        """
        ...

    def travels(self, ways: Floats) -> Floats:
        """The same bound (n,) for many motions of the joints (n, k)."""
        ...


class MovingHand(Protocol):
    """The hand of the arm that moves, for planners that think in the room.

    Configurations are those of the ground (n, k).
    """

    def poses(self, q: Floats) -> Floats:
        """The poses of the tool, or of the tip of what is in hand, in the world (n, 4, 4)."""
        ...

    def reaching(self, poses: Floats, near: Floats) -> list[Floats]:
        """For each pose (n, 4, 4) the configurations (m, k) within the limits that reach it,
        those nearest to `near` (k,) first.
        """
        ...

    def boxes(self) -> tuple[Floats, Floats]:
        """The boxes around what stands in the cell: their poses in the world (n, 4, 4), and
        half their edges (n, 3) in m.
        """
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

    def checker(self, scene: CollisionScene) -> CollisionChecker:
        """The checker for a scene.

        Raises `ValueError` when the backend cannot represent the scene.
        """
        ...

    def checker_of_few(self, scene: CollisionScene) -> CollisionChecker:
        """The same for a scene with few pairs, without what makes many pairs quick."""
        ...


class Gripper(Protocol):
    """A hand that takes parts: what of it may meet other things.

    Its frame lies between the tips, z to the part, x as it closes.
    """

    def blocks(self, opening: Sequence[float]) -> tuple[Floats, Floats]:
        """Middles (n, 3) and half extents (n, 3) of blocks along the hand's axes, opened for a
        grasp and a clearance beside it.
        """
        ...


class ContactFilter(Protocol):
    """Says which contact states of a cell are infeasible or unwanted. It is made for one
    `ContactModel`.

    It is asked about one cluster at a time, with one object for all that are alike. What it says
    must not depend on which of them it is, nor on which of several alike anchor points, except for
    those that it names in `individuals`.
    """

    def individuals(self) -> frozenset[tuple[str, str]]:
        """The anchor points (object class, anchor point) that are not exchangeable for this
        filter.
        """
        ...

    def reason(
        self, objects: Sequence[str], contacts: "Sequence[Octuple]", change: "Octuple | None"
    ) -> str:
        """Why a cluster of objects with these contacts cannot be; empty if it can.

        `change` is the contact that is made; None if one is broken, or if nothing changes.
        """
        ...


@dataclass(frozen=True, slots=True)
class DriverSetup:
    """What a driver is made for. `options` are its own, by name, as given on the command line
    (`--option name=value`).

    `factor` is the share of real time that a simulated clock takes: 0 as fast as can be, 1 in real
    time. `run` names the run, and with it whatever the driver keeps so that a run can be resumed.
    `fence` is the number of the lease under which the run is driven; it is greater for each process
    that takes the run up. A controller with the number refuses what comes with an older one.
    """

    problem: "Problem"
    run: str = ""
    seed: int = 0
    factor: float = 0.0
    options: Mapping[str, str] = field(default_factory=dict)
    fence: int = 0


class Driver(Protocol):
    """Carries out commands in a cell, real or simulated. Registered under the entry point
    `cellwright.drivers`.

    The entry point is a function that takes a `DriverSetup` and gives a driver that is ready to
    receive commands; it raises `InvalidInput` for a setup that it cannot serve. One thread calls a
    driver. No method but `receive` and `quiesce` waits.

    A driver that is connected again, or made again for the same `run`, knows all commands of this
    run by their numbers.
    """

    @property
    def tick_ms(self) -> int | None:
        """The control tick: `receive` returns at least so often, so that a stop is heard. None on a
        virtual clock.

        On a virtual clock nothing happens between events, and orders are given at times of that
        clock.
        """
        ...

    def now_ms(self) -> int:
        """The time on the driver's clock since the run began.

        It never goes back, also not across a reconnection.
        """
        ...

    def lookahead(self, stream: str) -> int:
        """How many commands of a stream may be sent before the first has ended.

        1 for a device without a queue: each command that it gets begins at once, also beside others
        of its stream. With more, the device carries out its commands one after another in the order
        of their numbers, and obeys WAIT and CONTINUE.
        """
        ...

    def send(self, commands: "Sequence[DriverCommand]") -> None:
        """Hand over commands, in the order of their numbers. A command with a number that is known
        is not carried out again.

        CONTINUE has no reply. WAIT is answered `waiting` when its turn has come. Every other
        command gets exactly one reply, unless it is dropped.
        """
        ...

    def receive(self, until_ms: int | None) -> "Sequence[Message]":
        """What has come since the last call, the oldest first; waits for it until this time of the
        clock (None: without limit).

        Nothing has come if the result is empty: the time has passed, or a control tick. A virtual
        clock jumps to the next event or to `until_ms`, whichever is earlier; with neither, the
        result is empty. A connection that is lost is a `Trouble`, not an exception.
        """
        ...

    def quiesce(self, within_ms: int) -> "Sequence[Message]":
        """Begin nothing more, drop what is queued, bring what is under way to its end, and give
        what came meanwhile.

        Commands of processes that need no hand, such as a furnace that heats, go on: their replies
        come later. What has not ended `within_ms` is left under way.
        """
        ...

    def halt(self) -> None:
        """Stop every motion at once.

        What was under way has no reply and counts as dropped or failed; `report` tells which.
        """
        ...

    def report(self, numbers: Sequence[int]) -> "Sequence[Report]":
        """What became of these commands, in this order.

        A resumed run asks so before it sends anything.
        """
        ...

    def close(self) -> None:
        """Leave the cell as it is, and give back what the driver holds.

        A process of its own may live on.
        """
        ...


@runtime_checkable
class KeepsTime(Protocol):
    """What a driver has beside whose cell may have begun to count its time anew."""

    def not_before(self, at_ms: int) -> None:
        """The clock is at least so far: the run, which goes on, has seen it there."""
        ...


@runtime_checkable
class Simulated(Protocol):
    """What a driver of a simulated cell has beside: nobody reaches into such a cell, so it is
    told what a person has changed.
    """

    def by_hand(self, adds: Sequence[str], ends: Sequence[str], reached: Mapping[str, int]) -> None:
        """Facts hold now, and others do not any more; so many stages of each chain are reached."""
        ...

    def not_come(self) -> Sequence[str]:
        """The faults that were ordered and have not come up, as they were written: too few such
        steps were begun.
        """
        ...
