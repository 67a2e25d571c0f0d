"""Makes a collision scene from a world: convex pieces on carriers, and pairs not to touch."""

from collections.abc import Collection, Iterator
from dataclasses import replace

import numpy as np

from cellwright.engine.kernels.arrays import Floats, Longs, Truths
from cellwright.engine.kernels.linear import matmul
from cellwright.engine.model.geometry import CollisionScene, ConvexPiece, Joints
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.shapes.part_shapes import shape_cores
from cellwright.engine.stages.geometry.world.geometric_world import (
    NO_JOINTS,
    GeometricWorld,
    LocatedFrame,
)
from cellwright.kb.model.body_shapes import PlacedShape
from cellwright.kb.model.cell_model import JointKind

Names = frozenset[frozenset[str]]
PIECE_ROWS = 256  # pieces whose pairs are looked at together


def collision_scene_of(
    world: GeometricWorld, leave_out: Collection[str] = (), allowed: Names = frozenset()
) -> CollisionScene:
    """The scene of everything in a world except the bodies `leave_out`.

    The `allowed` pairs may touch, too, beside those that the cell allows. Three kinds of pairs are
    not checked: those that move together, those that both stand still, and those that the arm or
    the cell allows.
    """
    return _make_scene(
        world.joints, world_pieces(world, leave_out), _allowed_contacts(world) | allowed
    )


def world_pieces(world: GeometricWorld, leave_out: Collection[str] = ()) -> tuple[ConvexPiece, ...]:
    """The pieces of everything in a world except the bodies `leave_out`."""
    return (
        *_link_pieces(world),
        *_body_pieces(world, leave_out),
        *_region_pieces(world, leave_out),
    )


def scene_of_pairs(world: GeometricWorld, pairs: Names) -> CollisionScene:
    """The scene in which some pairs of bodies are checked, and no others.

    What the cell allows to touch is not checked here either.
    """
    named = frozenset[str]().union(*pairs)
    bodies = _body_pieces(world, world.cell.bodies.keys() - named)
    regions = _region_pieces(world, world.cell.regions.keys() - named)
    links = (piece for piece in _link_pieces(world) if piece.body in named)
    return _make_scene(
        world.joints, (*links, *bodies, *regions), _allowed_contacts(world), wanted=pairs
    )


def free_scene_of(
    world: GeometricWorld, body: str, leave_out: Collection[str] = (), allowed: Names = frozenset()
) -> CollisionScene:
    """The scene of one freely moving body (such as a gripper alone) among everything that the arms
    do not carry. The body's frame is the moving carrier.
    """
    moving = tuple(_placed_pieces(body, LocatedFrame(1, np.eye(4)), world.cell.bodies[body].shapes))
    gone = {body, *leave_out}
    surroundings = (*_link_pieces(world), *_body_pieces(world, gone), *_region_pieces(world, gone))
    standing = tuple(piece for piece in surroundings if piece.carrier == 0)
    return _make_scene(
        NO_JOINTS, (*moving, *standing), _allowed_contacts(world) | allowed, free=True
    )


def riding_scene_of(world: GeometricWorld, body: str) -> CollisionScene:
    """The scene in which a body goes along its joint with all that stands on it, arms included: its
    value is the first joint.

    Raises `ValueError` for a body without a joint, and for one that an arm carries.
    """
    guide, start = world.cell.bodies[body].guide, world.locate(world.placed[body].parent)
    if guide is None or start.carrier:
        raise ValueError(f"{body} does not go along a joint that stands still")
    zero = world.guided(body, 0.0)
    T_ride_world = transforms.inverse(zero.locate(body).T_carrier_frame)
    joints, pieces = zero.joints, collision_scene_of(zero).pieces
    moves = np.array(
        [body in zero.supports(_frame_of(zero, piece.body)) for piece in pieces], dtype=bool
    )
    riding = np.array(
        [
            body in zero.supports(f"{arm}.base")
            for arm in zero.cell.arms
            for _ in zero.models[arm].joints.axis
        ]
    )
    parent, origin = joints.parent + (joints.parent > 0), joints.T_parent_origin.copy()
    first = (joints.parent == 0) & riding
    parent[first], origin[first] = 1, matmul(T_ride_world, origin[first])
    ride_joints = Joints(
        np.concatenate([[0], parent]).astype(np.int64),
        np.concatenate([transforms.inverse(T_ride_world)[None], origin]),
        np.concatenate([[guide.axis], joints.axis]),
        np.concatenate([[guide.kind is JointKind.PRISMATIC], joints.prismatic]),
        np.concatenate([[guide.lower], joints.lower]),
        np.concatenate([[guide.upper], joints.upper]),
    )
    carried = tuple(
        _on_ride(piece, rides, T_ride_world) for piece, rides in zip(pieces, moves, strict=True)
    )
    return _make_scene(ride_joints, carried, _allowed_contacts(zero))


def _frame_of(world: GeometricWorld, body: str) -> str:
    """The frame that what a piece belongs to stands on."""
    arm = body.partition(".")[0]
    return f"{arm}.base" if arm in world.cell.arms and body not in world.cell.bodies else body


def _on_ride(piece: ConvexPiece, rides: bool, T_ride_world: Floats) -> ConvexPiece:
    """A piece in a scene with one joint more: on it, if it stood on the world and rides along."""
    if piece.carrier:
        return replace(piece, carrier=piece.carrier + 1)
    if not rides:
        return piece
    return replace(piece, carrier=1, T_carrier_piece=matmul(T_ride_world, piece.T_carrier_piece))


def _make_scene(
    joints: Joints,
    pieces: tuple[ConvexPiece, ...],
    allowed: Names,
    free: bool = False,
    wanted: Names | None = None,
) -> CollisionScene:
    bodies = tuple(dict.fromkeys(piece.body for piece in pieces))
    return CollisionScene(joints, pieces, _colliding_pairs(pieces, allowed, wanted), free, bodies)


def _colliding_pairs(
    pieces: tuple[ConvexPiece, ...], allowed: Names, wanted: Names | None = None
) -> Longs:
    """All pairs of pieces on two carriers, in order, except for those of bodies that may touch.

    Where pairs of bodies are `wanted`, only their pieces count.
    """
    names = {name: n for n, name in enumerate(dict.fromkeys(piece.body for piece in pieces))}
    body = np.array([names[piece.body] for piece in pieces], dtype=np.int64)
    carrier = np.array([piece.carrier for piece in pieces], dtype=np.int64)
    checked = ~_allowed_pairs_of(names, allowed)
    if wanted is not None:
        checked &= _allowed_pairs_of(names, wanted)
    pair_blocks = [np.zeros((0, 2), dtype=np.int64)]
    for first in range(0, len(pieces), PIECE_ROWS):
        rows = slice(first, first + PIECE_ROWS)
        met = np.triu(checked[body[rows]][:, body] & (carrier[rows, None] != carrier), first + 1)
        pair_blocks.append(np.argwhere(met) + np.array([first, 0]))
    return np.concatenate(pair_blocks)


def _allowed_pairs_of(names: dict[str, int], pairs: Names) -> Truths:
    """Whether two bodies are one of the pairs (n, n), by their numbers.

    A pair of one name is a body and itself.
    """
    is_between = np.zeros((len(names), len(names)), dtype=bool)
    for pair in pairs:
        if pair <= names.keys():
            ends = sorted(names[name] for name in pair)
            is_between[ends[0], ends[-1]] = is_between[ends[-1], ends[0]] = True
    return is_between


def _allowed_contacts(world: GeometricWorld) -> Names:
    own = {
        frozenset(f"{name}.{link}" for link in pair)
        for name, mounted in world.cell.arms.items()
        for pair in mounted.arm.allowed
    }
    return world.cell.allowed | own


def _placed_pieces(
    body: str, at: LocatedFrame, shapes: tuple[PlacedShape, ...]
) -> Iterator[ConvexPiece]:
    for placed in shapes:
        T = matmul(at.T_carrier_frame, transforms.of_pose(placed.pose))
        for core in shape_cores(placed.shape):
            yield ConvexPiece(body, at.carrier, T, core.vertices, core.radius_m, core.box)


def _link_pieces(world: GeometricWorld) -> Iterator[ConvexPiece]:
    for name, mounted in world.cell.arms.items():
        for link in mounted.arm.links:
            yield from _placed_pieces(
                f"{name}.{link.name}", world.locate_link(name, link), link.shapes
            )


def _body_pieces(world: GeometricWorld, leave_out: Collection[str]) -> Iterator[ConvexPiece]:
    for name, body in world.cell.bodies.items():
        if name not in leave_out:
            yield from _placed_pieces(name, world.locate(name), body.shapes)


def _region_pieces(world: GeometricWorld, leave_out: Collection[str]) -> Iterator[ConvexPiece]:
    """The pieces of solid regions. These stand for real things that no body describes."""
    for name, region in world.cell.regions.items():
        if region.solid and name not in leave_out:
            yield from pieces_of_region(world, name)


def pieces_of_region(world: GeometricWorld, name: str) -> list[ConvexPiece]:
    """The convex pieces of a region that the cell declares."""
    region = world.cell.regions[name]
    below = world.locate(region.placement.parent)
    T: Floats = matmul(below.T_carrier_frame, transforms.of_pose(region.placement.pose))
    return list(_placed_pieces(name, LocatedFrame(below.carrier, T), (PlacedShape(region.shape),)))
