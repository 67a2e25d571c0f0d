"""Fitted shapes and alignments of a part (text: mm and degrees; data: metres and radians)."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from rich.text import Text

from cellwright.engine.kernels.rigid import rotation_vector
from cellwright.engine.model.part_measurements import Triple
from cellwright.engine.model.shape_fits import (
    SHAPE_PARAMETERS,
    Aligning,
    Alignment,
    Fit,
    FitShape,
    Fitting,
    Related,
)

FIT_COVERAGE = 1.96  # standard deviations on either side: 95 % of a normal distribution


def fit_entry(fitting: Fitting) -> dict[str, Any]:
    """A fit as plain values, in metres and radians."""
    if not isinstance(fitting, Fit):
        return {"reason": fitting.reason}
    content: dict[str, Any] = {
        "shape": fitting.shape.value,
        "origin": fitting.origin.tolist(),
        "used": int(fitting.used.sum()),
        "points": len(fitting.used),
        "chi2": fitting.chi2,
        "freedom": fitting.freedom,
        "parameters": list(SHAPE_PARAMETERS[fitting.shape]),
        "covariance": fitting.covariance.tolist(),
    }
    if fitting.shape is not FitShape.SPHERE:
        content["axis"] = fitting.axis.tolist()
    if fitting.shape is not FitShape.PLANE:
        content["radius"] = fitting.radius_m
    if fitting.shape is FitShape.CONE:
        content["angle"] = fitting.angle_rad
    return content


def related_entries(relations: Iterable[Related]) -> list[dict[str, Any]]:
    """Distances in metres and angles in radians, with their standard deviations."""
    return [
        {"what": relation.what, "of": relation.of, "value": relation.value, "sigma": relation.sigma}
        for relation in relations
    ]


def fits_text(fittings: Iterable[Fitting], between: Iterable[Related]) -> Text:
    """Fits in sentences, and what is between them; what is uncertain with the half width of 95
    %.
    """
    return Text(
        "\n".join(
            [line for fitting in fittings for line in _fit_lines(fitting)]
            + [_relation_text(relation) for relation in between]
        )
    )


def _relation_text(relation: Related) -> str:
    sure = FIT_COVERAGE * relation.sigma
    if relation.what == "angle":
        return (
            f"angle {relation.of} {np.degrees(relation.value):.4f} degrees to "
            f"{np.degrees(sure):.2g} degrees"
        )
    return f"{relation.what} {relation.of} {1e3 * relation.value:.4f} mm to {1e3 * sure:.2g} mm"


def _fit_lines(fitting: Fitting) -> list[str]:
    if not isinstance(fitting, Fit):
        return [f"no fit: {fitting.reason}"]
    lines = [
        f"{fitting.shape} through {fitting.used.sum()} of {len(fitting.used)} points",
        *_size_lines(fitting),
    ]
    ratio = fitting.chi2 / fitting.freedom if fitting.freedom else 1.0
    off = (
        "as far as --noise says"
        if 0.5 < ratio < 2.0
        else f"{np.sqrt(ratio):.2g} times as far as --noise says"
    )
    return [*lines, f"the points that belong to it deviate {off}"]


def _place_text(shape_fit: Fit) -> str:
    """Where a shape is, and how sure that is in the directions in which it can be told."""
    where = f"({', '.join(f'{1e3 * coordinate:.4f}' for coordinate in shape_fit.origin)}) mm"
    if shape_fit.shape in (FitShape.SPHERE, FitShape.CIRCLE):
        turned = (
            shape_fit.T_world_shape[:3, :3]
            @ shape_fit.covariance[:3, :3]
            @ shape_fit.T_world_shape[:3, :3].T
        )
        return (
            f"centre {where} to "
            f"({', '.join(_half_width(deviation) for deviation in np.sqrt(np.diag(turned)))}) mm"
        )
    if shape_fit.shape is FitShape.PLANE:
        return f"point on it {where} to {_half_width(shape_fit.deviation('z'))} mm along its normal"
    across = float(np.sqrt(np.linalg.eigvalsh(shape_fit.covariance[:2, :2])[-1]))
    return f"point on its axis {where} to {_half_width(across)} mm across it"


def _half_width(sigma_m: float) -> str:
    return f"{1e3 * FIT_COVERAGE * sigma_m:.2g}"


def _size_lines(shape_fit: Fit) -> list[str]:
    lines = [_place_text(shape_fit)]
    if shape_fit.shape is not FitShape.SPHERE:
        name = "normal" if shape_fit.shape in (FitShape.PLANE, FitShape.CIRCLE) else "axis"
        tilt = np.degrees(
            FIT_COVERAGE * max(shape_fit.deviation("tilt_x"), shape_fit.deviation("tilt_y"))
        )
        lines.append(
            f"{name} ({', '.join(f'{component:.5f}' for component in shape_fit.axis)}) to "
            f"{tilt:.2g} degrees"
        )
    if shape_fit.shape is not FitShape.PLANE:
        sure = 2e3 * FIT_COVERAGE * shape_fit.deviation("radius")
        diameter_word = "diameter at that point" if shape_fit.shape is FitShape.CONE else "diameter"
        lines.append(f"{diameter_word} {2e3 * shape_fit.radius_m:.4f} mm to {sure:.2g} mm")
    if shape_fit.shape is FitShape.CONE:
        sure = np.degrees(FIT_COVERAGE * shape_fit.deviation("angle"))
        lines.append(
            f"half angle {np.degrees(shape_fit.angle_rad):.3f} degrees to {sure:.2g} degrees"
        )
    return lines


ALIGNMENT_COVERAGE = 2.0  # standard deviations


def alignment_entry(
    alignment: Aligning, names: Sequence[str], places: Sequence[Triple]
) -> dict[str, Any]:
    """An alignment as plain values; `places` are the points of the part whose uncertainty is
    told.
    """
    if not isinstance(alignment, Alignment):
        return {"reason": alignment.reason, "wrong": list(alignment.off)}
    return {
        "transform": alignment.T_measured_nominal.tolist(),
        "centre": alignment.centre.tolist(),
        "covariance": alignment.covariance.tolist(),
        "used": [name for name, used in zip(names, alignment.used, strict=True) if used],
        "wrong": [name for name, used in zip(names, alignment.used, strict=True) if not used],
        "sigma_m": float(alignment.sigma_at(np.array(places)).max()),
        "turn_sigma_rad": alignment.turn_sigma_rad,
        "chi2": alignment.chi2,
        "freedom": alignment.freedom,
    }


def alignment_text(
    alignment: Aligning, names: Sequence[str], places: Sequence[Triple], file: str
) -> Text:
    """An alignment in sentences."""
    if not isinstance(alignment, Alignment):
        return Text(f"no alignment: {alignment.reason}")
    T, centre = alignment.T_measured_nominal, alignment.centre
    shift = 1e3 * (T[:3, :3] @ centre + T[:3, 3] - centre)
    turn = np.degrees(rotation_vector(T[:3, :3]))
    sure = 1e3 * ALIGNMENT_COVERAGE * float(alignment.sigma_at(np.array(places)).max())
    lines = [
        f"the part is shifted by ({_three_decimals(shift)}) mm and turned by "
        f"({_three_decimals(turn)}) degrees",
        f"its points are known to {sure:.2g} mm, its turn to "
        f"{np.degrees(ALIGNMENT_COVERAGE * alignment.turn_sigma_rad):.2g} degrees",
        f"{alignment.used.sum()} of {len(names)} datums agree",
    ]
    lines += [
        f"  {name} is wrong: {off:.1f} standard deviations off"
        for name, used, off in zip(names, alignment.used, alignment.off, strict=True)
        if not used
    ]
    return Text(
        "\n".join([*lines, *([f"{file}: the problem with its points moved"] if file else [])])
    )


def _three_decimals(v: Any) -> str:
    return ", ".join(f"{coordinate + 0.0:.3f}" for coordinate in np.round(v, 3))
