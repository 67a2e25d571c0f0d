"""Measures where a surface is, by the patch of a range image kept for its measurement."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from cellwright.engine.kernels.arrays import Floats
from cellwright.engine.model.arm_poses import MeasurementPoses
from cellwright.engine.model.shape_fits import Fit, FitShape, Fitting
from cellwright.engine.model.vision import EdgeImage, PixelWindow, RangeImage, Vague
from cellwright.engine.pipelines.inspection.measurement_places import with_measured_places
from cellwright.engine.pipelines.motion.image_dimensions import (
    DimensionRequest,
    dimensions_in_image,
)
from cellwright.engine.pipelines.motion.measurement_poses import (
    chosen_tools,
    known_poses,
    station_world,
)
from cellwright.engine.pipelines.motion.ranging_views import (
    eye_of,
    solids_before,
    take_image,
    unwrap_image,
    window_of,
)
from cellwright.engine.pipelines.planning.plan_gate import PlanGate
from cellwright.engine.ports import GeometryBackend
from cellwright.engine.stages.geometry import transforms
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source, unknown_name
from cellwright.kb.model.cell_model import Cell, Measuring, Place, Ranging
from cellwright.kb.model.planning_problem import Problem


@dataclass(frozen=True, slots=True, eq=False)
class ImageRequest:
    """How an image comes about. `expected_to_m` is the standard deviation of where the part is.

    `read` gives the image that a tool has taken. Without it an image is made, with errors by
    `seed`; everything really lies `displaced_m` (3,) from where it is expected, in the world.
    """

    expected_to_m: float
    seed: int = 0
    displaced_m: Floats | None = None
    read: Callable[[Ranging], RangeImage] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class MeasuredSurface:
    """The image, the patch, the plane in it, and how far the surface is from where it should be,
    along its normal, in metres.

    `answered` is the image before its ranges were resolved. `expected_m` is the standard deviation
    that was expected when the patch was chosen.
    """

    name: str
    poses: MeasurementPoses
    answered: RangeImage
    image: RangeImage
    edges: EdgeImage
    window: PixelWindow
    fit: Fitting
    off_m: float
    sigma_m: float
    expected_m: float

    @property
    def sure(self) -> bool:
        """Whether a plane was found."""
        return isinstance(self.fit, Fit)


def measured_surface(
    problem: Problem,
    cell: Cell,
    backend: GeometryBackend,
    name: str,
    seeing: ImageRequest,
) -> MeasuredSurface | Vague:
    """The surface at a measurement that a laser ranging tool takes.

    Raises `InvalidInput` for one that it does not.
    """
    tools = chosen_tools(PlanGate().semantics(problem))
    how, ranging = _measuring_tool(problem, cell, tools, name)
    poses, place, placed = _first_pose(problem, cell, backend, name, tools)
    world = station_world(placed, PlanGate().semantics(problem), poses.station, place)
    eye = eye_of(world, place, how, ranging, poses.straight[0][-1], solids_before(world, place.arm))
    answered = (
        take_image(eye, seeing.seed, seeing.displaced_m)
        if seeing.read is None
        else _checked_image(seeing.read(ranging), ranging, tools[name])
    )
    image = unwrap_image(eye, answered, seeing.expected_to_m)
    if isinstance(image, Vague):
        return image
    at = place.surface or place.placement
    surface = world.pose("world", at.parent) @ transforms.of_pose(at.pose)
    point, normal = surface[:3, 3], -surface[:3, 2]
    assert poses.patch is not None
    window = window_of(eye, poses.patch, point)
    measured = dimensions_in_image(image, [DimensionRequest(name, FitShape.PLANE, window)])
    fit = measured.fits[name]
    off, sigma = (
        _surface_offset(fit, eye.T_world_eye, point, normal) if isinstance(fit, Fit) else (0.0, 0.0)
    )
    return MeasuredSurface(
        name, poses, answered, image, measured.edges, window, fit, off, sigma, poses.sigma_m
    )


def ranging_of(cell: Cell, tool: str) -> Ranging:
    """What a laser ranging tool of a cell is like.

    Raises `InvalidInput` for a name that is none.
    """
    rangings = {
        name: measuring.ranging
        for name, measuring in cell.measuring.items()
        if measuring.ranging is not None
    }
    if (ranging := rangings.get(tool)) is None:
        raise InvalidInput(
            [unknown_name("laser ranging tool", tool, rangings, Source(cell.path or cell.name))]
        )
    return ranging


def _checked_image(image: RangeImage, tool: Ranging, name: str) -> RangeImage:
    """An image that was read, if this tool has taken it."""
    if image.tool != tool:
        message = f"another tool than {name} of this cell has taken the image"
        hint = f"take it with {name}, or correct `ranging` in the cell"
        raise InvalidInput([Diagnostic(Source(name), "K702", message, hint)])
    return image


def _measuring_tool(
    problem: Problem, cell: Cell, tools: Mapping[str, str], name: str
) -> tuple[Measuring, Ranging]:
    """How the tool of a measurement measures.

    Raises `InvalidInput` for no measurement, and for one that another kind of tool takes.
    """
    if name not in tools:
        where = Source(problem.path or problem.name)
        raise InvalidInput([unknown_name("measurement", name, tools, where)])
    how = cell.measuring.get(tools[name])
    if how is None or how.ranging is None:
        message = f"{name} is taken with {tools[name]}, which is no laser ranging tool"
        hint = (
            f"say what it is like: `measuring: {tools[name]}: ranging`, or name another measurement"
        )
        raise InvalidInput([Diagnostic(Source(cell.path or cell.name), "K404", message, hint)])
    return how, how.ranging


def _first_pose(
    problem: Problem, cell: Cell, backend: GeometryBackend, name: str, tools: Mapping[str, str]
) -> tuple[MeasurementPoses, Place, Cell]:
    """The poses of a measurement from the first station that reaches it, its place, and the
    cell with its place.
    """
    where = Source(cell.path or cell.name)
    whole = with_measured_places(cell, problem, tools)
    knowledge = known_poses(problem, cell, backend, only=(name,))
    reached = [
        knowledge.poses[key] for key in sorted(knowledge.poses) if knowledge.poses[key].reached
    ]
    if not reached:
        why = knowledge.unreached().get(name, "it has no place in the cell")
        raise InvalidInput(
            [Diagnostic(where, "K404", f"{name} is not reached: {why}", "give it another place")]
        )
    place = whole.places[problem.domain.conventions.place(name)]
    return reached[0], place, whole


def _surface_offset(
    fit: Fit, T_world_eye: Floats, point: Floats, normal: Floats
) -> tuple[float, float]:
    """How far a plane lies from a point (3,), along a normal, and the standard deviation."""
    back = transforms.inverse(T_world_eye)
    own, away = transforms.apply(back, point[None])[0], back[:3, :3] @ normal
    facing = float(fit.axis @ away)
    off = float(fit.axis @ (fit.origin - own)) / facing
    x, y, _ = fit.T_world_shape[:3, :3].T @ (own - fit.origin)
    by = np.array([1.0, -x, -y])
    return off, float(np.sqrt(by @ fit.covariance @ by)) / abs(facing)
