"""Makes a collision scene from a world: convex pieces on carriers, and the pairs that must not touch."""

from collections.abc import Collection, Iterator
from dataclasses import replace

import numpy as np

from cellwright.engine.kernels.linear import matmul
from cellwright.engine.model.geometry import Floats, Joints, Longs, Piece, Scene, Truths
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.shapes.parts import cores
from cellwright.engine.stages.geometry.world.model import NO_JOINTS, Located, World
from cellwright.kb.model.cell import JointKind
from cellwright.kb.model.shapes import PlacedShape

Names = frozenset[frozenset[str]]
ROWS = 256  # pieces whose pairs are looked at together


def scene_of(world: World, leave_out: Collection[str] = (), allowed: Names = frozenset()) -> Scene:
    """The scene of everything in a world except the bodies `leave_out`.

    The `allowed` pairs may touch, too, beside those that the cell allows. Three kinds of pairs are not
    checked: those that move together, those that both stand still, and those that the arm or the cell allows.
    """
    return _scene(world.joints, pieces_of(world, leave_out), _allowed(world) | allowed)


def pieces_of(world: World, leave_out: Collection[str] = ()) -> tuple[Piece, ...]:
    """The pieces of everything in a world except the bodies `leave_out`."""
    return (*_link_pieces(world), *_body_pieces(world, leave_out), *_region_pieces(world, leave_out))


def scene_of_pairs(world: World, pairs: Names) -> Scene:
    """The scene in which some pairs of bodies are checked, and no others. What the cell allows to touch is not checked here either."""
    named = frozenset[str]().union(*pairs)
    bodies = _body_pieces(world, world.cell.bodies.keys() - named)
    regions = _region_pieces(world, world.cell.regions.keys() - named)
    links = (piece for piece in _link_pieces(world) if piece.body in named)
    return _scene(world.joints, (*links, *bodies, *regions), _allowed(world), wanted=pairs)


def free_scene_of(
    world: World, body: str, leave_out: Collection[str] = (), allowed: Names = frozenset()
) -> Scene:
    """The scene of one freely moving body (such as a gripper alone) among everything that the arms do not
    carry. The body's frame is the moving carrier.
    """
    moving = tuple(_placed(body, Located(1, np.eye(4)), world.cell.bodies[body].shapes))
    left = {body, *leave_out}
    others = (*_link_pieces(world), *_body_pieces(world, left), *_region_pieces(world, left))
    standing = tuple(piece for piece in others if piece.carrier == 0)
    return _scene(NO_JOINTS, (*moving, *standing), _allowed(world) | allowed, free=True)


def riding_scene_of(world: World, body: str) -> Scene:
    """The scene in which a body goes along its joint with all that stands on it, arms included: its value is the first joint.

    Raises `ValueError` for a body without a joint, and for one that an arm carries.
    """
    guide, start = world.cell.bodies[body].guide, world.locate(world.placed[body].parent)
    if guide is None or start.carrier:
        raise ValueError(f"{body} does not go along a joint that stands still")
    zero = world.guided(body, 0.0)
    T_ride_world = transforms.inverse(zero.locate(body).T_carrier_frame)
    joints, pieces = zero.joints, scene_of(zero).pieces
    moves = np.array([body in zero.supports(_frame_of(zero, piece.body)) for piece in pieces], dtype=bool)
    riding = np.array(
        [body in zero.supports(f"{arm}.base") for arm in zero.cell.arms for _ in zero.models[arm].joints.axis]
    )
    parent, origin = joints.parent + (joints.parent > 0), joints.T_parent_origin.copy()
    first = (joints.parent == 0) & riding
    parent[first], origin[first] = 1, matmul(T_ride_world, origin[first])
    found = Joints(
        np.concatenate([[0], parent]).astype(np.int64),
        np.concatenate([transforms.inverse(T_ride_world)[None], origin]),
        np.concatenate([[guide.axis], joints.axis]),
        np.concatenate([[guide.kind is JointKind.PRISMATIC], joints.prismatic]),
        np.concatenate([[guide.lower], joints.lower]),
        np.concatenate([[guide.upper], joints.upper]),
    )
    carried = tuple(_on_ride(each, rides, T_ride_world) for each, rides in zip(pieces, moves, strict=True))
    return _scene(found, carried, _allowed(zero))


def _frame_of(world: World, body: str) -> str:
    """The frame that what a piece belongs to stands on."""
    arm = body.partition(".")[0]
    return f"{arm}.base" if arm in world.cell.arms and body not in world.cell.bodies else body


def _on_ride(piece: Piece, rides: bool, T_ride_world: Floats) -> Piece:
    """A piece in a scene with one joint more: on it, if it stood on the world and rides along."""
    if piece.carrier:
        return replace(piece, carrier=piece.carrier + 1)
    if not rides:
        return piece
    return replace(piece, carrier=1, T_carrier_piece=matmul(T_ride_world, piece.T_carrier_piece))


def _scene(
    joints: Joints, pieces: tuple[Piece, ...], allowed: Names, free: bool = False, wanted: Names | None = None
) -> Scene:
    bodies = tuple(dict.fromkeys(piece.body for piece in pieces))
    return Scene(joints, pieces, _pairs(pieces, allowed, wanted), free, bodies)


def _pairs(pieces: tuple[Piece, ...], allowed: Names, wanted: Names | None = None) -> Longs:
    """All pairs of pieces on two carriers, in order, except for those of bodies that may touch.

    Where pairs of bodies are `wanted`, only their pieces count.
    """
    names = {name: n for n, name in enumerate(dict.fromkeys(piece.body for piece in pieces))}
    body = np.array([names[piece.body] for piece in pieces], dtype=np.int64)
    carrier = np.array([piece.carrier for piece in pieces], dtype=np.int64)
    checked = ~_between(names, allowed)
    if wanted is not None:
        checked &= _between(names, wanted)
    found = [np.zeros((0, 2), dtype=np.int64)]
    for first in range(0, len(pieces), ROWS):
        rows = slice(first, first + ROWS)
        met = np.triu(checked[body[rows]][:, body] & (carrier[rows, None] != carrier), first + 1)
        found.append(np.argwhere(met) + np.array([first, 0]))
    return np.concatenate(found)


def _between(names: dict[str, int], pairs: Names) -> Truths:
    """Whether two bodies are one of the pairs (n, n), by their numbers. A pair of one name is a body and itself."""
    found = np.zeros((len(names), len(names)), dtype=bool)
    for pair in pairs:
        if pair <= names.keys():
            ends = sorted(names[name] for name in pair)
            found[ends[0], ends[-1]] = found[ends[-1], ends[0]] = True
    return found


def _allowed(world: World) -> Names:
    own = {
        frozenset(f"{name}.{link}" for link in pair)
        for name, mounted in world.cell.arms.items()
        for pair in mounted.arm.allowed
    }
    return world.cell.allowed | own


def _placed(body: str, at: Located, shapes: tuple[PlacedShape, ...]) -> Iterator[Piece]:
    for placed in shapes:
        T = matmul(at.T_carrier_frame, transforms.of_pose(placed.pose))
        for core in cores(placed.shape):
            yield Piece(body, at.carrier, T, core.vertices, core.radius_m, core.box)


def _link_pieces(world: World) -> Iterator[Piece]:
    for name, mounted in world.cell.arms.items():
        for link in mounted.arm.links:
            yield from _placed(f"{name}.{link.name}", world.locate_link(name, link), link.shapes)


def _body_pieces(world: World, leave_out: Collection[str]) -> Iterator[Piece]:
    for name, body in world.cell.bodies.items():
        if name not in leave_out:
            yield from _placed(name, world.locate(name), body.shapes)


def _region_pieces(world: World, leave_out: Collection[str]) -> Iterator[Piece]:
    """The pieces of solid regions. These stand for real things that no body describes."""
    for name, region in world.cell.regions.items():
        if region.solid and name not in leave_out:
            yield from pieces_of_region(world, name)


def pieces_of_region(world: World, name: str) -> list[Piece]:
    """The convex pieces of a region that the cell declares."""
    region = world.cell.regions[name]
    below = world.locate(region.placement.parent)
    T: Floats = matmul(below.T_carrier_frame, transforms.of_pose(region.placement.pose))
    return list(_placed(name, Located(below.carrier, T), (PlacedShape(region.shape),)))
