"""MuJoCo model (XML) of a cell: arms with servos, furniture on joints, free parts."""

from collections.abc import Iterator
from xml.sax.saxutils import quoteattr

import numpy as np

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.shapes.part_shapes import shape_cores
from cellwright.engine.stages.geometry.world.geometric_world import GeometricWorld
from cellwright.kb.model.body_shapes import Box, Cylinder, PlacedShape, Sphere, Tube
from cellwright.kb.model.cell_model import Body, BodyKind, Cell, Guide, JointKind, Link


def exchanged_tools(cell: Cell) -> frozenset[str]:
    """The tools that arms take up and put down: those that places or measurements name."""
    named = {place.tool for place in cell.places.values()} | set(cell.measuring)
    return frozenset(name for name in named if name in cell.bodies)


def is_free(cell: Cell, body: str) -> bool:
    """Whether a body stands on nothing for good: a part, or a tool that is exchanged."""
    return cell.bodies[body].kind is BodyKind.PART or body in exchanged_tools(cell)


def bearer_of(world: GeometricWorld, frame: str) -> str:
    """The body that a frame stands on, or `ARM.flange`, or `world`."""
    on = world.placed[frame].parent
    while on in world.cell.frames or ("." in on and on.partition(".")[0] in world.cell.bodies):
        on = world.placed[on].parent
    return on


def holder_of(world: GeometricWorld, tool: str) -> str:
    """The body of the model that holds a tool: what it hangs on, or the flange of the arm that
    has it.
    """
    on = bearer_of(world, tool)
    arm = on.partition(".")[0]
    return f"{arm}.flange" if arm in world.cell.arms else on


def carriers_of(world: GeometricWorld) -> frozenset[str]:
    """The bodies with a joint that carry an arm."""
    below = {support for arm in world.cell.arms for support in world.supports(f"{arm}.base")}
    bodies = world.cell.bodies
    return frozenset(body for body in below if body in bodies and bodies[body].guide is not None)


def held_by(world: GeometricWorld, arm: str) -> list[str]:
    """The parts and tools that an arm has in its hand."""
    return [
        name
        for name in world.cell.bodies
        if is_free(world.cell, name)
        and world.placed[name].parent in (f"{arm}.tool", f"{arm}.flange")
    ]


def worn_by(world: GeometricWorld, arm: str) -> Iterator[str]:
    """The bodies that are mounted on an arm for good: its gripper and the fingers."""
    for body in world.cell.bodies:
        on = world.supports(body)[1:]
        if not is_free(world.cell, body) and any(
            body.startswith(f"{arm}.") and body != f"{arm}.base" for body in on
        ):
            yield body


def finger_bodies(world: GeometricWorld, arm: str) -> list[str]:
    """The bodies with drives of their own on an arm: its fingers."""
    bodies = world.cell.bodies
    return [
        body
        for body in worn_by(world, arm)
        if (guide := bodies[body].guide) is not None and not guide.follows
    ]


def in_hand(world: GeometricWorld, body: str) -> bool:
    """Whether an arm has a part or tool in its hand."""
    return any(body in held_by(world, arm) for arm in world.cell.arms)


def in_hands(world: GeometricWorld) -> frozenset[str]:
    """The parts and tools that any arm has in its hand."""
    return frozenset(body for arm in world.cell.arms for body in held_by(world, arm))


MODEL_STEP_S = 0.002
STIFF, DAMPED = 40_000.0, 2_000.0  # N m/rad and N m s/rad of the servos of an arm
JOINT_ARMATURE = 2.0  # kg m^2 of the drive of a joint
# how a body follows another: two fingers stay in the middle
RIGID_CONTACT = 'solref="0.008 1" solimp="0.99 0.999 0.0001"'
GRIP_N = 80.0  # greatest force of a body's own drive
DEFAULT_DENSITY = 700.0  # kg/m^3 where no mass is given: housings are hollow
DEFAULT_FRICTION = 0.8
# How much stiffer friction is than what presses: with soft friction, what is gripped creeps, at a
# speed that falls as this grows.
IMPEDANCE_RATIO = 30
# m: friction against turning on a spot as wide as a finger's pad, and against rolling
TWIST_FRICTION = "0.02 0.0001"
# how contacts give way: as little as the time step allows
FIRM_CONTACT = 'solref="0.004 1" solimp="0.95 0.99 0.0005"'


def mujoco_xml(world: GeometricWorld) -> str:
    """The model of a world.

    Its joints are called ARM/JOINT and BODY, its servos like their joints.
    """
    writer = _ModelWriter(world)
    tree = "\n".join(writer.standing("world"))
    return f"""<mujoco model={quoteattr(world.cell.name)}>
<compiler angle="radian" autolimits="true" boundmass="0.01" boundinertia="0.0001"/>
<option timestep="{MODEL_STEP_S}" integrator="implicitfast" cone="elliptic" impratio="{IMPEDANCE_RATIO}" jacobian="sparse"><flag sleep="enable"/></option>
<default><geom density="{DEFAULT_DENSITY}" friction="{DEFAULT_FRICTION} {TWIST_FRICTION}" condim="4" {FIRM_CONTACT}/></default>
<asset>
{chr(10).join(writer.meshes)}
</asset>
<worldbody>
{tree}
</worldbody>
<contact>
{chr(10).join(writer.excluded())}
</contact>
<equality>
{chr(10).join(writer.followers)}
</equality>
<actuator>
{chr(10).join(writer.servos)}
</actuator>
</mujoco>
"""


class _ModelWriter:
    """Writes bodies one inside the other, and collects meshes and servos."""

    def __init__(self, world: GeometricWorld) -> None:
        self.world, self.meshes, self.servos, self.followers = (
            world,
            list[str](),
            list[str](),
            list[str](),
        )
        self.by_hand, self.carriers = dragged_by_hand(world.cell), carriers_of(world)
        self.children: dict[str, list[str]] = {}
        for name in world.cell.bodies:
            self.children.setdefault(bearer_of(world, name), []).append(name)

    def standing(self, on: str) -> Iterator[str]:
        """The bodies and arms that stand on a frame, with all that stands on them; parts and
        tools are free in the world.
        """
        cell = self.world.cell
        for name in self.children.get(on, ()):
            if not is_free(cell, name):
                yield self._body(name, cell.bodies[name], on)
        if on == "world":
            for name, body in cell.bodies.items():
                if is_free(cell, name):
                    yield self._free(name, body)
        for name in cell.arms:
            if bearer_of(self.world, f"{name}.base") == on:
                yield self._links(name, 0, self.world.pose(on, f"{name}.base"))

    def _free(self, name: str, body: Body) -> str:
        """A part, which may be made to stick where it is; or a tool, which hangs at a latch."""
        T, quoted = self.world.pose("world", name), quoteattr(name)
        if body.kind is BodyKind.PART:
            weld = f'name={quoteattr(f"stuck/{name}")} body1={quoted} active="false"'
        else:
            holder = quoteattr(holder_of(self.world, name))
            weld = (
                f"name={quoteattr(f'latch/{name}')} body1={quoted} body2={holder} {RIGID_CONTACT}"
            )
        self.followers.append(f"<weld {weld}/>")
        return (
            f"<body name={quoted} {_pose_text(T)}><freejoint "
            f"name={quoted}/>{self._geoms(name, body)}</body>"
        )

    def _body(self, name: str, body: Body, on: str) -> str:
        home = self.world.pose(on, name)
        joint = ""
        if body.guide is not None:
            home = self.world.guided(name, 0.0).pose(on, name)
            joint = self._guide(name, body.guide)
        inner = "".join(self.standing(name))
        compensated = 'gravcomp="1" ' if on != "world" or body.guide is not None else ""
        return (
            f"<body name={quoteattr(name)} "
            f"{compensated}{_pose_text(home)}>{joint}{self._geoms(name, body)}{inner}</body>"
        )

    def _guide(self, name: str, guide: Guide) -> str:
        slides = guide.kind is JointKind.PRISMATIC
        kind, damping, rubs = ("slide", 60.0, 4.0) if slides else ("hinge", 1.0, 0.2)
        rubs = rubs if name in self.by_hand else 0.0
        limits = f"{guide.lower - 1e-4} {guide.upper + 1e-4}"
        stiff, drive = (6_000.0, 2.0) if slides else (60.0, 0.02)
        if guide.follows:
            same = (
                f'joint1={quoteattr(name)} joint2={quoteattr(guide.follows)} polycoef="0 1 0 0 '
                f'0" {RIGID_CONTACT}'
            )
            self.followers.append(f"<joint {same}/>")
        if name not in self.by_hand:
            most = "" if name in self.carriers else f' forcerange="{-GRIP_N} {GRIP_N}"'
            self.servos.append(
                f'<position name={quoteattr(name)} joint={quoteattr(name)} kp="{stiff}" '
                f'kv="{stiff / 20}"{most}/>'
            )
        axis = " ".join(map(str, guide.axis))
        return (
            f'<joint name={quoteattr(name)} type="{kind}" axis="{axis}" range="{limits}" '
            f'damping="{damping}" frictionloss="{rubs}" '
            f'armature="{0.0 if name in self.by_hand else drive}"/>'
        )

    def _links(self, arm: str, carrier: int, T: Floats) -> str:
        """The links on a carrier of an arm, and the next joint inside of it."""
        model = self.world.models[arm]
        links = [link for link in model.arm.links if link.carrier == carrier]
        geoms = "".join(self._link(arm, link) for link in links)
        name, joint = f"{arm}/{carrier}", ""
        if carrier:
            joint = self._joint(arm, carrier - 1)
        inner = ""
        if carrier < model.joints.count:
            inner = self._links(arm, carrier + 1, model.joints.T_parent_origin[carrier])
        else:
            inner = (
                f'<body name={quoteattr(f"{arm}.flange")} gravcomp="1" '
                f"{_pose_text(model.T_last_flange)}>{_SPECK_INERTIA}{''.join(self.standing(f'{arm}.flange'))}</body>"
            )
        return (
            f'<body name={quoteattr(name)} gravcomp="1" '
            f"{_pose_text(T)}>{joint}{geoms or _SPECK_INERTIA}{inner}</body>"
        )

    def _joint(self, arm: str, index: int) -> str:
        model = self.world.models[arm]
        joint, name = model.arm.joints[index], f"{arm}/{model.arm.joints[index].name}"
        kind = "slide" if joint.kind is JointKind.PRISMATIC else "hinge"
        force = f' forcerange="{-joint.effort} {joint.effort}"' if joint.effort else ""
        self.servos.append(
            f'<position name={quoteattr(name)} joint={quoteattr(name)} kp="{STIFF}" '
            f'kv="{DAMPED}"{force}/>'
        )
        axis = " ".join(str(float(value)) for value in model.joints.axis[index])
        low, high = model.joints.lower[index], model.joints.upper[index]
        limits = f' range="{low - 0.01} {high + 0.01}"' if np.isfinite([low, high]).all() else ""
        return (
            f'<joint name={quoteattr(name)} type="{kind}" axis="{axis}"{limits} '
            f'armature="{JOINT_ARMATURE}"/>'
        )

    def _link(self, arm: str, link: Link) -> str:
        offset = transforms.of_offsets(link.offset)
        name = f"{arm}.{link.name}"
        inertia = ""
        if link.inertia is not None:
            T, moments = offset @ transforms.of_pose(link.inertia.centre), link.inertia.moments
            full = " ".join(str(moments[n]) for n in (0, 3, 5, 1, 2, 4))
            at = " ".join(str(float(value)) for value in T[:3, 3])
            inertia = f'<inertial pos="{at}" mass="{link.inertia.mass_kg}" fullinertia="{full}"/>'
        return inertia + self._shapes(name, link.shapes, offset, "")

    def _geoms(self, name: str, body: Body) -> str:
        extra = "" if body.friction is None else f' friction="{body.friction} {TWIST_FRICTION}"'
        return self._shapes(name, body.shapes, np.eye(4), extra) or _SPECK_INERTIA

    def _shapes(
        self, name: str, shapes: tuple[PlacedShape, ...], offset: Floats, extra: str
    ) -> str:
        elements = []
        for number, placed in enumerate(shapes):
            at = _pose_text(offset @ transforms.of_pose(placed.pose))
            simple = _simple_shape(placed)
            if simple:
                elements.append(
                    f"<geom name={quoteattr(f'{name}:{number}')} {simple} {at}{extra}/>"
                )
                continue
            for part, core in enumerate(shape_cores(placed.shape)):
                mesh = f"{name}:{number}:{part}"
                vertices = " ".join(f"{value:.9g}" for value in core.vertices.ravel())
                self.meshes.append(f'<mesh name={quoteattr(mesh)} vertex="{vertices}"/>')
                elements.append(
                    f'<geom name={quoteattr(mesh)} type="mesh" mesh={quoteattr(mesh)} {at}{extra}/>'
                )
        return "".join(elements)

    def excluded(self) -> Iterator[str]:
        """The pairs of bodies that may touch, or can never touch, as the arm and the cell say."""
        cell = self.world.cell
        pairs = {*cell.allowed}
        for name, mounted in cell.arms.items():
            pairs |= {frozenset(f"{name}.{link}" for link in pair) for pair in mounted.arm.allowed}
        seen = set[tuple[str, str]]()
        for pair in sorted(sorted(pair) for pair in pairs):
            first, second = sorted(self._body_of(name) for name in (pair[0], pair[-1]))
            if first != second and (first, second) not in seen:
                seen.add((first, second))
                yield f"<exclude body1={quoteattr(first)} body2={quoteattr(second)}/>"

    def _body_of(self, name: str) -> str:
        arm, _, link = name.partition(".")
        if arm in self.world.cell.arms:
            carrier = next(
                arm_link.carrier
                for arm_link in self.world.models[arm].arm.links
                if arm_link.name == link
            )
            return f"{arm}/{carrier}"
        return name


def dragged_by_hand(cell: Cell) -> frozenset[str]:
    """The bodies that an arm grips and moves itself: they have no drive of their own."""
    dragged = {
        operation.drags
        for operation in cell.operations
        if operation.drags and _is_gripped(cell, operation.drags, str(operation.at))
    }
    return frozenset(dragged)


def _is_gripped(cell: Cell, body: str, place: str) -> bool:
    return place in cell.places and body in cell.places[place].touches


_SPECK_INERTIA = '<inertial pos="0 0 0" mass="0.1" diaginertia="0.001 0.001 0.001"/>'


def _simple_shape(placed: PlacedShape) -> str:
    """The shape as one of MuJoCo's own; empty for one that it has not."""
    match placed.shape:
        case Sphere(radius):
            return f'type="sphere" size="{radius}"'
        case Tube(radius, length):
            return f'type="capsule" size="{radius} {length / 2}"'
        case Cylinder(radius, length):
            return f'type="cylinder" size="{radius} {length / 2}"'
        case Box(size):
            return f'type="box" size="{" ".join(str(edge / 2) for edge in size)}"'
        case _:
            return ""


def _pose_text(T: Floats) -> str:
    """Position and quaternion of a pose."""
    position = " ".join(f"{float(value):.9g}" for value in T[:3, 3])
    turned = " ".join(f"{float(value):.9g}" for value in quaternion_of(T[:3, :3]))
    return f'pos="{position}" quat="{turned}"'


def quaternion_of(R: Floats) -> Floats:
    """The unit quaternion (w, x, y, z) of a rotation (3, 3)."""
    vector = transforms.rotation_vector(R)
    angle = float(np.linalg.norm(vector))
    if angle < 1e-12:
        return np.array([1.0, 0.0, 0.0, 0.0])
    q: Floats = np.concatenate([[np.cos(angle / 2)], np.sin(angle / 2) * vector / angle])
    return q
