"""Where parts belong: relations between named features of bodies become their poses."""

from collections.abc import Collection, Sequence

import numpy as np

from cellwright.engine.kernels.rigid import apply
from cellwright.engine.model.assembly import AssemblyAnswer, Feature, FeatureKind, Relation, RelationKind
from cellwright.engine.model.geometry import Floats
from cellwright.engine.stages.assembly.relations import assemble
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.shapes.parts import features
from cellwright.engine.stages.geometry.world.model import World
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source, unknown_name
from cellwright.kb.model.cell import Body
from cellwright.kb.model.scene import SaidRelation, Scene
from cellwright.kb.model.shapes import Cylinder, PlacedShape


def goal_of(scene: Scene, world: World, parts: Collection[str], base: str) -> AssemblyAnswer:
    """The poses T_base_part with which all relations of some parts hold, and what is free in them.

    Other bodies that the relations name stay where they are. Raises `InvalidInput` for unknown bodies and features, and where
    nothing is said of a part.
    """
    for name in (*parts, base):
        if name not in world.cell.bodies:
            raise InvalidInput([unknown_name("body", name, world.cell.bodies, Source(name))])
    said = [each for each in scene.relations if {each.first[0], each.second[0]} & set(parts)]
    for part in parts:
        if not any(part in (each.first[0], each.second[0]) for each in said):
            hint = f"write under `relations:` how {part} shall lie, such as: {part}.bottom against {base}.top"
            raise InvalidInput(
                [Diagnostic(Source(scene.name), "K005", f"no relation says where {part} belongs", hint)]
            )
    try:
        starts = {part: world.pose(base, part) for part in parts}
        return assemble([_bound(each, world, {*parts, base}, base) for each in said], base, starts)
    except ValueError as error:
        raise InvalidInput(
            [Diagnostic(said[0].where, "K005", str(error), "relate features of two bodies")]
        ) from None


def _bound(said: SaidRelation, world: World, moving: Collection[str], base: str) -> Relation:
    ends = [_feature(body, name, said, world, moving, base) for body, name in (said.first, said.second)]
    return Relation(RelationKind(said.kind), ends[0], ends[1], said.value, said.preferred)


def _feature(
    body: str, name: str, said: SaidRelation, world: World, moving: Collection[str], base: str
) -> Feature:
    """A named feature: of what is placed in its own frame, of any other body in the frame of the base."""
    known = features_of(world.cell.bodies[body])
    if name not in known:
        raise InvalidInput([unknown_name(f"feature of {body}", name, known, said.where)])
    found = known[name]
    if body in moving:
        return found
    T = world.pose(base, body)
    point, direction = apply(T, found.point[None])[0], T[:3, :3] @ found.direction
    return Feature(base, f"{body}.{name}", found.kind, point, direction)


def features_of(body: Body) -> dict[str, Feature]:
    """The features of a body by name: faces, edges and vertices, the axes and ends of cylinders, and its named poses.

    A pose counts as the line along its z axis. With several shapes, names that two of them have begin with `shape_2.` and so on.
    """
    listed = [(n, each) for n, placed in enumerate(body.shapes, 1) for each in _of_shape(body.name, placed)]
    names = [each.name for _, each in listed]
    found = {
        each.name if names.count(each.name) == 1 else f"shape_{n}.{each.name}": each for n, each in listed
    }
    for name, pose in body.features.items():
        T = transforms.of_pose(pose)
        found[name] = Feature(body.name, name, FeatureKind.LINE, T[:3, 3], T[:3, 2])
    return found


def _of_shape(body: str, placed: PlacedShape) -> Sequence[Feature]:
    if isinstance(placed.shape, Cylinder):
        return _of_cylinder(body, placed, placed.shape.length_m)
    own = features(placed)
    faces = [
        Feature(body, name, FeatureKind.PLANE, face.corners.mean(axis=0), face.normal)
        for name, face in own.faces.items()
    ]
    edges = [
        Feature(body, name, FeatureKind.LINE, ends[0], _unit(ends[1] - ends[0]))
        for name, ends in own.edges.items()
    ]
    points = [Feature(body, name, FeatureKind.POINT, at, np.zeros(3)) for name, at in own.vertices.items()]
    return [*faces, *edges, *points]


def _of_cylinder(body: str, placed: PlacedShape, length_m: float) -> Sequence[Feature]:
    T = transforms.of_pose(placed.pose)
    along, middle = T[:3, 2], T[:3, 3]
    return [
        Feature(body, "axis", FeatureKind.LINE, middle, along),
        Feature(body, "top", FeatureKind.PLANE, middle + along * length_m / 2, along),
        Feature(body, "bottom", FeatureKind.PLANE, middle - along * length_m / 2, -along),
    ]


def _unit(vector: Floats) -> Floats:
    found: Floats = vector / np.linalg.norm(vector)
    return found
