"""PLACE: goal poses from relations, the part from an image, and the path between the two."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from typing import TypeAlias

import numpy as np

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.kernels.rigid import apply, difference, inverse
from cellwright.engine.model.manipulation_values import (
    Assembled,
    AssemblyAnswer,
    FeatureKind,
    Grasp,
    PartFeature,
    Relation,
    RelationContradiction,
    RelationKind,
)
from cellwright.engine.model.vision import LocatedPart, NotLocated
from cellwright.engine.pipelines.manipulation.carry_paths import (
    LIFT_M,
    end_configurations,
    gross_motion,
    may_touch,
    straight_leg,
)
from cellwright.engine.pipelines.manipulation.clearance import insertion_of
from cellwright.engine.pipelines.manipulation.part_grasps import (
    HAND_BACK_OFF_M,
    HAND_BODY,
    ArmReach,
    with_hand,
)
from cellwright.engine.pipelines.manipulation.place_answers import (
    NotPlaced,
    PathLeg,
    PlaceAnswer,
    Placed,
)
from cellwright.engine.pipelines.manipulation.pose_uncertainty import brought_covariance as doubted
from cellwright.engine.pipelines.manipulation.regrasp_paths import (
    bring_part,
    most_vertical,
    possible_holds,
)
from cellwright.engine.pipelines.manipulation.scene_camera import SceneView, look_for_parts
from cellwright.engine.pipelines.manipulation.workspace import (
    AssemblySite,
    HandApproachKind,
    MotionManner,
    PlaceTask,
)
from cellwright.engine.stages.assembly.part_assembly import assemble_parts
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.shapes.part_shapes import shape_features
from cellwright.engine.stages.geometry.world.geometric_world import GeometricWorld
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source, unknown_name
from cellwright.kb.model.body_shapes import Cylinder, PlacedShape
from cellwright.kb.model.cell_model import Body
from cellwright.kb.model.part_scene import SaidRelation, Scene


def goal_of(
    scene: Scene, world: GeometricWorld, parts: Collection[str], base: str
) -> AssemblyAnswer:
    """The poses T_base_part with which all relations of some parts hold, and what is free in them.

    Other bodies that the relations name stay where they are. Raises `InvalidInput` for unknown
    bodies and features, and where nothing is said of a part.
    """
    for name in (*parts, base):
        if name not in world.cell.bodies:
            raise InvalidInput([unknown_name("body", name, world.cell.bodies, Source(name))])
    said_relations = [
        relation
        for relation in scene.relations
        if {relation.first[0], relation.second[0]} & set(parts)
    ]
    for part in parts:
        if not any(part in (relation.first[0], relation.second[0]) for relation in said_relations):
            hint = (
                f"write under `relations:` how {part} shall lie, such as: {part}.bottom against "
                f"{base}.top"
            )
            raise InvalidInput(
                [
                    Diagnostic(
                        Source(scene.name), "K005", f"no relation says where {part} belongs", hint
                    )
                ]
            )
    try:
        starts = {part: world.pose(base, part) for part in parts}
        return assemble_parts(
            [_bind_relation(relation, world, {*parts, base}, base) for relation in said_relations],
            base,
            starts,
        )
    except ValueError as error:
        raise InvalidInput(
            [
                Diagnostic(
                    said_relations[0].where, "K005", str(error), "relate features of two bodies"
                )
            ]
        ) from None


def _bind_relation(
    said: SaidRelation, world: GeometricWorld, moving: Collection[str], base: str
) -> Relation:
    ends = [
        _named_feature(body, name, said, world, moving, base)
        for body, name in (said.first, said.second)
    ]
    return Relation(RelationKind(said.kind), ends[0], ends[1], said.value, said.preferred)


def _named_feature(
    body: str,
    name: str,
    said: SaidRelation,
    world: GeometricWorld,
    moving: Collection[str],
    base: str,
) -> PartFeature:
    """A named feature: of what is placed in its own frame, of any other body in the frame of
    the base.
    """
    known_features = body_features(world.cell.bodies[body])
    if name not in known_features:
        raise InvalidInput([unknown_name(f"feature of {body}", name, known_features, said.where)])
    feature = known_features[name]
    if body in moving:
        return feature
    T = world.pose(base, body)
    point, direction = apply(T, feature.point[None])[0], T[:3, :3] @ feature.direction
    return PartFeature(base, f"{body}.{name}", feature.kind, point, direction)


def body_features(body: Body) -> dict[str, PartFeature]:
    """The features of a body by name: faces, edges and vertices, the axes and ends of cylinders,
    and its named poses.

    A pose counts as the line along its z axis. With several shapes, names that two of them have
    begin with `shape_2.` and so on.
    """
    listed = [
        (n, feature)
        for n, placed in enumerate(body.shapes, 1)
        for feature in _of_shape(body.name, placed)
    ]
    names = [feature.name for _, feature in listed]
    features = {
        feature.name if names.count(feature.name) == 1 else f"shape_{n}.{feature.name}": feature
        for n, feature in listed
    }
    for name, pose in body.features.items():
        T = transforms.of_pose(pose)
        features[name] = PartFeature(body.name, name, FeatureKind.LINE, T[:3, 3], T[:3, 2])
    return features


def _of_shape(body: str, placed: PlacedShape) -> Sequence[PartFeature]:
    if isinstance(placed.shape, Cylinder):
        return _of_cylinder(body, placed, placed.shape.length_m)
    own = shape_features(placed)
    faces = [
        PartFeature(body, name, FeatureKind.PLANE, face.corners.mean(axis=0), face.normal)
        for name, face in own.faces.items()
    ]
    edges = [
        PartFeature(body, name, FeatureKind.LINE, ends[0], _unit_vector(ends[1] - ends[0]))
        for name, ends in own.edges.items()
    ]
    points = [
        PartFeature(body, name, FeatureKind.POINT, at, np.zeros(3))
        for name, at in own.vertices.items()
    ]
    return [*faces, *edges, *points]


def _of_cylinder(body: str, placed: PlacedShape, length_m: float) -> Sequence[PartFeature]:
    T = transforms.of_pose(placed.pose)
    along, middle = T[:3, 2], T[:3, 3]
    return [
        PartFeature(body, "axis", FeatureKind.LINE, middle, along),
        PartFeature(body, "top", FeatureKind.PLANE, middle + along * length_m / 2, along),
        PartFeature(body, "bottom", FeatureKind.PLANE, middle - along * length_m / 2, -along),
    ]


def _unit_vector(vector: Floats) -> Floats:
    unit: Floats = vector / np.linalg.norm(vector)
    return unit


ANY_WAY = MotionManner(HandApproachKind.COMPLETE)
STILL_M, STILL_RAD = 0.002, np.radians(1)  # what has moved less is where it was


def place_part(
    scene: Scene,
    part: str,
    base: str,
    seed: int = 0,
    image: Floats | None = None,
    manner: MotionManner = ANY_WAY,
) -> tuple[PlaceAnswer, SceneView | None]:
    """The way of a part to where the relations say, and what was seen.

    Raises `InvalidInput` for names that are not there.
    """
    world = GeometricWorld.of(scene.cell)
    goal = goal_of(scene, world, (part,), base)
    if isinstance(goal, RelationContradiction):
        return contradiction_answer(goal), None
    looked = look_for_parts(scene, world, (part,), seed, image)
    sighting = looked.sightings[part]
    if isinstance(sighting, NotLocated):
        return not_seen_answer(part, sighting), looked
    T_goal = world.pose("world", base) @ goal.poses[part]
    T_start = likeliest_pose(sighting, looked.T_world_camera, T_goal)
    task = AssemblySite.of(scene, world, looked, {part: T_start}, manner).task(
        part, (T_start, T_goal)
    )
    at, carries = bring_part(task, world.configuration)
    if isinstance(carries, NotPlaced):
        return carries, looked
    counts = (len(task.holds.poses), int(at[0].sum()), int(at[1].sum()))
    holds = task.holds
    taken = tuple(
        (holds.poses[n], holds.grasps[holds.grasp_of[n]].width_m) for n in np.nonzero(at[0])[0]
    )
    fit = insertion_of(task, doubted(sighting, carries, T_goal), carries[-1].T_part_hand)
    carries = (*carries[:-1], replace(carries[-1], insertion=fit))
    return Placed(goal, sighting, T_start, T_goal, counts, carries, taken), looked


@dataclass(frozen=True, slots=True, eq=False)
class SecondLook:
    """What a second look shows, just before the part is taken: how far it was moved since (m, rad),
    and the plan from there on.

    A plan that still holds is kept.
    """

    moved_m: float
    moved_rad: float
    answer: PlaceAnswer
    looked: SceneView


def look_again(scene: Scene, part: str, base: str, plan: Placed, image: Floats) -> SecondLook:
    """The plan after a second look: the same if the part is where it was, else one from where
    it is now.
    """
    world = GeometricWorld.of(scene.cell)
    looked = look_for_parts(scene, world, (part,), 0, image)
    sighting = looked.sightings[part]
    if isinstance(sighting, NotLocated):
        return SecondLook(np.inf, np.inf, not_seen_answer(part, sighting), looked)
    apart = [
        difference(plan.T_world_part, looked.T_world_camera @ T_camera_part)
        for T_camera_part in sighting.equivalent
    ]
    metres, radians = min(apart, key=lambda pair: float(pair[0] + 0.05 * pair[1]))
    if metres < STILL_M and radians < STILL_RAD:
        return SecondLook(float(metres), float(radians), plan, looked)
    anew, _ = place_part(scene, part, base, image=image)
    return SecondLook(float(metres), float(radians), anew, looked)


def contradiction_answer(goal: RelationContradiction) -> NotPlaced:
    """What is said where relations contradict each other."""
    relations = ", ".join(map(str, goal.relations))
    return NotPlaced(
        "relations", f"these cannot hold together: {relations}", "leave one of them out", goal
    )


def not_seen_answer(part: str, sighting: NotLocated) -> NotPlaced:
    """What is said where a part is not found."""
    hint = "look from another place, or remove what hides it"
    return NotPlaced("sight", f"{part} is not found: {sighting.reason}", hint, sighting)


def likeliest_pose(sighting: LocatedPart, T_world_camera: Floats, T_goal: Floats) -> Floats:
    """T_world_part: of the poses that look the same, the one from which the part is turned least on
    its way to the goal.

    A turn about the vertical counts less than one that brings another side up.
    """
    poses = [T_world_camera @ T_camera_part for T_camera_part in sighting.equivalent]
    up = T_goal[2, :3]
    turn = [np.trace(T_goal[:3, :3].T @ T[:3, :3]) for T in poses]
    best = max(
        range(len(poses)), key=lambda n: (round(float(poses[n][2, :3] @ up), 2), turn[n], -n)
    )
    return poses[best]


HIGH_M = 0.25  # how high above where it lies the part is, if the relation does not say otherwise
MAX_ALIGNED_HOLDS = 12


@dataclass(frozen=True, slots=True, eq=False)
class BroughtPart:
    """The part is held where the relation holds: its pose in the world, what is still free in
    it, the grasp, and the legs.
    """

    goal: Assembled
    T_world_from: Floats
    T_world_part: Floats
    grasp: Grasp
    legs: tuple[PathLeg, ...]


Portion: TypeAlias = BroughtPart | NotPlaced


def bring_to_relation(
    scene: Scene, said: SaidRelation, seed: int = 0, image: Floats | None = None
) -> Portion:
    """The motions that make one relation between a part and another body hold.

    Raises `InvalidInput` for unknown names.
    """
    world, part, base = GeometricWorld.of(scene.cell), said.first[0], said.second[0]
    only = replace(scene, relations=(said,))
    goal_of(only, world, (part,), base)  # names are refused before anything is looked for
    looked = look_for_parts(only, world, (part,), seed, image)
    sighting = looked.sightings[part]
    if isinstance(sighting, NotLocated):
        return not_seen_answer(part, sighting)
    T_start = looked.T_world_camera @ sighting.best.T_camera_part
    lifted = T_start.copy()
    lifted[2, 3] += HIGH_M
    goal = goal_of(only, world.put(part, "world", lifted), (part,), base)
    if isinstance(goal, RelationContradiction):
        return contradiction_answer(goal)
    T_goal = world.pose("world", base) @ goal.poses[part]
    task = AssemblySite.of(scene, world, looked, {part: T_start}).task(part, (T_start, T_goal))
    serving_which = possible_holds(task, T_start)
    for hold in islice(most_vertical(task, serving_which), MAX_ALIGNED_HOLDS):
        legs = _held_out(task, hold, world.configuration)
        if legs is not None:
            return BroughtPart(
                goal, T_start, T_goal, task.holds.grasps[task.holds.grasp_of[hold]], legs
            )
    reason = f"no grasp with which {part} can be taken brings it to where the relation holds"
    return NotPlaced("motion", reason, "relate it to something that the arm reaches better")


def _held_out(task: PlaceTask, hold: int, near: Floats) -> tuple[PathLeg, ...] | None:
    """The legs that take the part with a hold and bring it to the task's goal, where it stays
    in the hand; None if there are none.
    """
    arm, T = task.scene.hand.arm, task.holds.poses[hold]
    opening = task.holds.grasps[task.holds.grasp_of[hold]].opening
    world = with_hand(task.world, task.scene, task.holds.jaws, opening)
    crowded = with_hand(task.crowded, task.scene, task.holds.jaws, opening)
    empty = ArmReach(world.put(task.part, "world", task.T_start), arm)
    above = ArmReach(crowded.put(task.part, "world", task.T_start), arm)
    full = ArmReach(world.put(task.part, f"{arm}.tool", inverse(T)), arm, may_touch(task))
    own = frozenset([frozenset((HAND_BODY, task.part))])
    free = ArmReach(crowded.put(task.part, f"{arm}.tool", inverse(T)), arm, own)
    start, goal = task.T_start @ T, task.T_goal @ T
    for q in end_configurations(empty, start, near):
        taken = empty.line(start, q, -HAND_BACK_OFF_M * start[:3, 2])
        lifted = full.line(start, q, np.array([0.0, 0.0, LIFT_M]))
        if (
            taken is None
            or lifted is None
            or (first := gross_motion(above, near, taken[-1])) is None
        ):
            continue
        for end in end_configurations(free, goal, lifted[-1]):
            if (second := gross_motion(free, lifted[-1], end)) is not None:
                return (
                    PathLeg("to the part", first.path, False, first.proved),
                    straight_leg("approach", taken[::-1], False, empty),
                    straight_leg("lift", lifted, True, full),
                    PathLeg("align", second.path, True, second.proved),
                )
    return None
