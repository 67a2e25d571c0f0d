"""A cell as a model of MuJoCo, in its XML: arms with position servos and compensated gravity, furniture on joints, free parts.

Masses follow from volumes; `servos.weighed` gives a body the one that is known. The implicit integrator and elliptic cones of friction hold what is gripped.
"""

from collections.abc import Iterator
from xml.sax.saxutils import quoteattr

import numpy as np

from cellwright.engine.model.geometry import Floats
from cellwright.engine.pipelines.witness.tree import bearer_of, carriers_of, holder_of, is_free
from cellwright.engine.stages.geometry import transforms
from cellwright.engine.stages.geometry.shapes.parts import cores
from cellwright.engine.stages.geometry.world.model import World
from cellwright.kb.model.cell import Body, BodyKind, Cell, Guide, JointKind, Link
from cellwright.kb.model.shapes import Box, Cylinder, PlacedShape, Sphere, Tube

STEP_S = 0.002
STIFF, DAMPED = 40_000.0, 2_000.0  # N m/rad and N m s/rad of the servos of an arm
ARMATURE = 2.0  # kg m^2 of the drive of a joint
RIGID = 'solref="0.008 1" solimp="0.99 0.999 0.0001"'  # how a body follows another: two fingers stay in the middle
GRIP_N = 80.0  # greatest force of a body's own drive
DENSITY = 700.0  # kg/m^3 where no mass is given: housings are hollow
FRICTION = 0.8
# How much stiffer friction is than what presses: with soft friction, what is gripped creeps, at a speed that falls as this grows.
STICKS = 30
TWIST = "0.02 0.0001"  # m: friction against turning on a spot as wide as a finger's pad, and against rolling
FIRM = (
    'solref="0.004 1" solimp="0.95 0.99 0.0005"'  # how contacts give way: as little as the time step allows
)


def written(world: World) -> str:
    """The model of a world. Its joints are called ARM/JOINT and BODY, its servos like their joints."""
    writer = _Writer(world)
    tree = "\n".join(writer.standing("world"))
    return f"""<mujoco model={quoteattr(world.cell.name)}>
<compiler angle="radian" autolimits="true" boundmass="0.01" boundinertia="0.0001"/>
<option timestep="{STEP_S}" integrator="implicitfast" cone="elliptic" impratio="{STICKS}" jacobian="sparse"><flag sleep="enable"/></option>
<default><geom density="{DENSITY}" friction="{FRICTION} {TWIST}" condim="4" {FIRM}/></default>
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


class _Writer:
    """Writes bodies one inside the other, and collects meshes and servos."""

    def __init__(self, world: World) -> None:
        self.world, self.meshes, self.servos, self.followers = world, list[str](), list[str](), list[str]()
        self.by_hand, self.carriers = dragged_by_hand(world.cell), carriers_of(world)
        self.children: dict[str, list[str]] = {}
        for name in world.cell.bodies:
            self.children.setdefault(bearer_of(world, name), []).append(name)

    def standing(self, on: str) -> Iterator[str]:
        """The bodies and arms that stand on a frame, with all that stands on them; parts and tools are free in the world."""
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
        T, known = self.world.pose("world", name), quoteattr(name)
        if body.kind is BodyKind.PART:
            weld = f'name={quoteattr(f"stuck/{name}")} body1={known} active="false"'
        else:
            holder = quoteattr(holder_of(self.world, name))
            weld = f"name={quoteattr(f'latch/{name}')} body1={known} body2={holder} {RIGID}"
        self.followers.append(f"<weld {weld}/>")
        return f"<body name={known} {_at(T)}><freejoint name={known}/>{self._geoms(name, body)}</body>"

    def _body(self, name: str, body: Body, on: str) -> str:
        home = self.world.pose(on, name)
        joint = ""
        if body.guide is not None:
            home = self.world.guided(name, 0.0).pose(on, name)
            joint = self._guide(name, body.guide)
        inner = "".join(self.standing(name))
        compensated = 'gravcomp="1" ' if on != "world" or body.guide is not None else ""
        return f"<body name={quoteattr(name)} {compensated}{_at(home)}>{joint}{self._geoms(name, body)}{inner}</body>"

    def _guide(self, name: str, guide: Guide) -> str:
        slides = guide.kind is JointKind.PRISMATIC
        kind, damping, rubs = ("slide", 60.0, 4.0) if slides else ("hinge", 1.0, 0.2)
        rubs = rubs if name in self.by_hand else 0.0
        limits = f"{guide.lower - 1e-4} {guide.upper + 1e-4}"
        stiff, drive = (6_000.0, 2.0) if slides else (60.0, 0.02)
        if guide.follows:
            same = f'joint1={quoteattr(name)} joint2={quoteattr(guide.follows)} polycoef="0 1 0 0 0" {RIGID}'
            self.followers.append(f"<joint {same}/>")
        if name not in self.by_hand:
            most = "" if name in self.carriers else f' forcerange="{-GRIP_N} {GRIP_N}"'
            self.servos.append(
                f'<position name={quoteattr(name)} joint={quoteattr(name)} kp="{stiff}" kv="{stiff / 20}"{most}/>'
            )
        axis = " ".join(map(str, guide.axis))
        return f'<joint name={quoteattr(name)} type="{kind}" axis="{axis}" range="{limits}" damping="{damping}" frictionloss="{rubs}" armature="{0.0 if name in self.by_hand else drive}"/>'

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
            inner = f'<body name={quoteattr(f"{arm}.flange")} gravcomp="1" {_at(model.T_last_flange)}>{_SPECK}{"".join(self.standing(f"{arm}.flange"))}</body>'
        return f'<body name={quoteattr(name)} gravcomp="1" {_at(T)}>{joint}{geoms or _SPECK}{inner}</body>'

    def _joint(self, arm: str, index: int) -> str:
        model = self.world.models[arm]
        known, name = model.arm.joints[index], f"{arm}/{model.arm.joints[index].name}"
        kind = "slide" if known.kind is JointKind.PRISMATIC else "hinge"
        force = f' forcerange="{-known.effort} {known.effort}"' if known.effort else ""
        self.servos.append(
            f'<position name={quoteattr(name)} joint={quoteattr(name)} kp="{STIFF}" kv="{DAMPED}"{force}/>'
        )
        axis = " ".join(str(float(each)) for each in model.joints.axis[index])
        low, high = model.joints.lower[index], model.joints.upper[index]
        limits = f' range="{low - 0.01} {high + 0.01}"' if np.isfinite([low, high]).all() else ""
        return f'<joint name={quoteattr(name)} type="{kind}" axis="{axis}"{limits} armature="{ARMATURE}"/>'

    def _link(self, arm: str, link: Link) -> str:
        offset = transforms.of_offsets(link.offset)
        name = f"{arm}.{link.name}"
        inertia = ""
        if link.inertia is not None:
            T, moments = offset @ transforms.of_pose(link.inertia.centre), link.inertia.moments
            full = " ".join(str(moments[n]) for n in (0, 3, 5, 1, 2, 4))
            at = " ".join(str(float(each)) for each in T[:3, 3])
            inertia = f'<inertial pos="{at}" mass="{link.inertia.mass_kg}" fullinertia="{full}"/>'
        return inertia + self._shapes(name, link.shapes, offset, "")

    def _geoms(self, name: str, body: Body) -> str:
        extra = "" if body.friction is None else f' friction="{body.friction} {TWIST}"'
        return self._shapes(name, body.shapes, np.eye(4), extra) or _SPECK

    def _shapes(self, name: str, shapes: tuple[PlacedShape, ...], offset: Floats, extra: str) -> str:
        found = []
        for number, placed in enumerate(shapes):
            at = _at(offset @ transforms.of_pose(placed.pose))
            simple = _simple(placed)
            if simple:
                found.append(f"<geom name={quoteattr(f'{name}:{number}')} {simple} {at}{extra}/>")
                continue
            for part, core in enumerate(cores(placed.shape)):
                mesh = f"{name}:{number}:{part}"
                vertices = " ".join(f"{each:.9g}" for each in core.vertices.ravel())
                self.meshes.append(f'<mesh name={quoteattr(mesh)} vertex="{vertices}"/>')
                found.append(f'<geom name={quoteattr(mesh)} type="mesh" mesh={quoteattr(mesh)} {at}{extra}/>')
        return "".join(found)

    def excluded(self) -> Iterator[str]:
        """The pairs of bodies that may touch, or can never touch, as the arm and the cell say."""
        cell = self.world.cell
        pairs = {*cell.allowed}
        for name, mounted in cell.arms.items():
            pairs |= {frozenset(f"{name}.{link}" for link in pair) for pair in mounted.arm.allowed}
        seen = set[tuple[str, str]]()
        for pair in sorted(sorted(each) for each in pairs):
            one, other = sorted(self._body_of(name) for name in (pair[0], pair[-1]))
            if one != other and (one, other) not in seen:
                seen.add((one, other))
                yield f"<exclude body1={quoteattr(one)} body2={quoteattr(other)}/>"

    def _body_of(self, name: str) -> str:
        arm, _, link = name.partition(".")
        if arm in self.world.cell.arms:
            carrier = next(each.carrier for each in self.world.models[arm].arm.links if each.name == link)
            return f"{arm}/{carrier}"
        return name


def dragged_by_hand(cell: Cell) -> frozenset[str]:
    """The bodies that an arm grips and moves itself: they have no drive of their own."""
    held = {each.drags for each in cell.operations if each.drags and _gripped(cell, each.drags, str(each.at))}
    return frozenset(held)


def _gripped(cell: Cell, body: str, place: str) -> bool:
    return place in cell.places and body in cell.places[place].touches


_SPECK = '<inertial pos="0 0 0" mass="0.1" diaginertia="0.001 0.001 0.001"/>'


def _simple(placed: PlacedShape) -> str:
    """The shape as one of MuJoCo's own; empty for one that it has not."""
    match placed.shape:
        case Sphere(radius):
            return f'type="sphere" size="{radius}"'
        case Tube(radius, length):
            return f'type="capsule" size="{radius} {length / 2}"'
        case Cylinder(radius, length):
            return f'type="cylinder" size="{radius} {length / 2}"'
        case Box(size):
            return f'type="box" size="{" ".join(str(each / 2) for each in size)}"'
        case _:
            return ""


def _at(T: Floats) -> str:
    """Position and quaternion of a pose."""
    position = " ".join(f"{float(each):.9g}" for each in T[:3, 3])
    turned = " ".join(f"{float(each):.9g}" for each in quaternion(T[:3, :3]))
    return f'pos="{position}" quat="{turned}"'


def quaternion(R: Floats) -> Floats:
    """The unit quaternion (w, x, y, z) of a rotation (3, 3)."""
    vector = transforms.rotation_vector(R)
    angle = float(np.linalg.norm(vector))
    if angle < 1e-12:
        return np.array([1.0, 0.0, 0.0, 0.0])
    found: Floats = np.concatenate([[np.cos(angle / 2)], np.sin(angle / 2) * vector / angle])
    return found
