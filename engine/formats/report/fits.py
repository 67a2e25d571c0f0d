"""Fitted shapes, for people and programs. People read millimetres and degrees, programs metres and radians."""

from collections.abc import Iterable
from typing import Any

import numpy as np
from rich.text import Text

from cellwright.engine.model.fits import PARAMETERS, Fit, Fitting, Related, Shape

COVERAGE = 1.96  # standard deviations on either side: 95 % of a normal distribution


def entry(found: Fitting) -> dict[str, Any]:
    """A fit as plain values, in metres and radians."""
    if not isinstance(found, Fit):
        return {"reason": found.reason}
    content: dict[str, Any] = {
        "shape": found.shape.value,
        "origin": found.origin.tolist(),
        "used": int(found.used.sum()),
        "points": len(found.used),
        "chi2": found.chi2,
        "freedom": found.freedom,
        "parameters": list(PARAMETERS[found.shape]),
        "covariance": found.covariance.tolist(),
    }
    if found.shape is not Shape.SPHERE:
        content["axis"] = found.axis.tolist()
    if found.shape is not Shape.PLANE:
        content["radius"] = found.radius_m
    if found.shape is Shape.CONE:
        content["angle"] = found.angle_rad
    return content


def related(found: Iterable[Related]) -> list[dict[str, Any]]:
    """Distances in metres and angles in radians, with their standard deviations."""
    return [{"what": each.what, "of": each.of, "value": each.value, "sigma": each.sigma} for each in found]


def text(found: Iterable[Fitting], between: Iterable[Related]) -> Text:
    """Fits in sentences, and what is between them; what is uncertain with the half width of 95 %."""
    return Text(
        "\n".join([line for each in found for line in _lines(each)] + [_between(each) for each in between])
    )


def _between(each: Related) -> str:
    sure = COVERAGE * each.sigma
    if each.what == "angle":
        return f"angle {each.of} {np.degrees(each.value):.4f} degrees to {np.degrees(sure):.2g} degrees"
    return f"{each.what} {each.of} {1e3 * each.value:.4f} mm to {1e3 * sure:.2g} mm"


def _lines(found: Fitting) -> list[str]:
    if not isinstance(found, Fit):
        return [f"no fit: {found.reason}"]
    lines = [f"{found.shape} through {found.used.sum()} of {len(found.used)} points", *_sizes(found)]
    ratio = found.chi2 / found.freedom if found.freedom else 1.0
    off = (
        "as far as --noise says"
        if 0.5 < ratio < 2.0
        else f"{np.sqrt(ratio):.2g} times as far as --noise says"
    )
    return [*lines, f"the points that belong to it deviate {off}"]


def _place(found: Fit) -> str:
    """Where a shape is, and how sure that is in the directions in which it can be told."""
    where = f"({', '.join(f'{1e3 * each:.4f}' for each in found.origin)}) mm"
    if found.shape in (Shape.SPHERE, Shape.CIRCLE):
        turned = found.T_world_shape[:3, :3] @ found.covariance[:3, :3] @ found.T_world_shape[:3, :3].T
        return f"centre {where} to ({', '.join(_wide(each) for each in np.sqrt(np.diag(turned)))}) mm"
    if found.shape is Shape.PLANE:
        return f"point on it {where} to {_wide(found.deviation('z'))} mm along its normal"
    across = float(np.sqrt(np.linalg.eigvalsh(found.covariance[:2, :2])[-1]))
    return f"point on its axis {where} to {_wide(across)} mm across it"


def _wide(sigma_m: float) -> str:
    return f"{1e3 * COVERAGE * sigma_m:.2g}"


def _sizes(found: Fit) -> list[str]:
    lines = [_place(found)]
    if found.shape is not Shape.SPHERE:
        name = "normal" if found.shape in (Shape.PLANE, Shape.CIRCLE) else "axis"
        tilt = np.degrees(COVERAGE * max(found.deviation("tilt_x"), found.deviation("tilt_y")))
        lines.append(f"{name} ({', '.join(f'{each:.5f}' for each in found.axis)}) to {tilt:.2g} degrees")
    if found.shape is not Shape.PLANE:
        sure = 2e3 * COVERAGE * found.deviation("radius")
        said = "diameter at that point" if found.shape is Shape.CONE else "diameter"
        lines.append(f"{said} {2e3 * found.radius_m:.4f} mm to {sure:.2g} mm")
    if found.shape is Shape.CONE:
        sure = np.degrees(COVERAGE * found.deviation("angle"))
        lines.append(f"half angle {np.degrees(found.angle_rad):.3f} degrees to {sure:.2g} degrees")
    return lines
