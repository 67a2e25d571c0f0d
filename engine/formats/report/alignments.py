"""Where a part lies, for people and programs. People read millimetres and degrees, programs metres and radians."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from rich.text import Text

from cellwright.engine.kernels.rigid import rotation_vector
from cellwright.engine.model.fits import Aligning, Alignment
from cellwright.engine.model.measurement import Triple

COVERAGE = 2.0  # standard deviations


def entry(found: Aligning, names: Sequence[str], places: Sequence[Triple]) -> dict[str, Any]:
    """An alignment as plain values; `places` are the points of the part whose uncertainty is told."""
    if not isinstance(found, Alignment):
        return {"reason": found.reason, "wrong": list(found.off)}
    return {
        "transform": found.T_measured_nominal.tolist(),
        "centre": found.centre.tolist(),
        "covariance": found.covariance.tolist(),
        "used": [name for name, used in zip(names, found.used, strict=True) if used],
        "wrong": [name for name, used in zip(names, found.used, strict=True) if not used],
        "sigma_m": float(found.sigma_at(np.array(places)).max()),
        "turn_sigma_rad": found.turn_sigma_rad,
        "chi2": found.chi2,
        "freedom": found.freedom,
    }


def text(found: Aligning, names: Sequence[str], places: Sequence[Triple], file: str) -> Text:
    """An alignment in sentences."""
    if not isinstance(found, Alignment):
        return Text(f"no alignment: {found.reason}")
    T, centre = found.T_measured_nominal, found.centre
    shift = 1e3 * (T[:3, :3] @ centre + T[:3, 3] - centre)
    turn = np.degrees(rotation_vector(T[:3, :3]))
    sure = 1e3 * COVERAGE * float(found.sigma_at(np.array(places)).max())
    lines = [
        f"the part is shifted by ({_three(shift)}) mm and turned by ({_three(turn)}) degrees",
        f"its points are known to {sure:.2g} mm, its turn to {np.degrees(COVERAGE * found.turn_sigma_rad):.2g} degrees",
        f"{found.used.sum()} of {len(names)} datums agree",
    ]
    lines += [
        f"  {name} is wrong: {off:.1f} standard deviations off"
        for name, used, off in zip(names, found.used, found.off, strict=True)
        if not used
    ]
    return Text("\n".join([*lines, *([f"{file}: the problem with its points moved"] if file else [])]))


def _three(v: Any) -> str:
    return ", ".join(f"{each + 0.0:.3f}" for each in np.round(v, 3))
