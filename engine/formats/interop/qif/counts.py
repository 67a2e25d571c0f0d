"""The number of points that a feature needs, by published feature rules.

The rules come from the QIF example `featureRules2` (after Lockheed Martin 100-46, "Inspection and Acceptance
Criteria", 2010), whose unit is the inch. If several rules apply, the largest count is taken. The rules for a diameter give
the number of points on each cross-section, as their text says.
"""

import math

from cellwright.engine.model.measurement import Feature

INCH = 0.0254
DIAMETER_POINTS = ((0.001, 32), (0.002, 24), (0.005, 18), (0.010, 12), (0.020, 8), (0.040, 5))
PROFILE_DENSITY = ((0.010, 0.2), (0.030, 0.1))  # points for each square inch
OTHERWISE = 3


def surface_points(area_m2: float, feature: Feature) -> int:
    """Points on a surface: by its area and its profile tolerance."""
    area, profile = area_m2 / INCH**2, feature.tolerances.get("SurfaceProfile", math.inf) / INCH
    counts = [OTHERWISE]
    counts += [4] if area > 2 else []
    counts += [5] if area > 25 else []
    density = next((density for limit, density in PROFILE_DENSITY if profile < limit), 0.0)
    return max(*counts, math.ceil(density * area - 1e-9))


def curve_points(length_m: float, feature: Feature) -> int:
    """Points on a curve: by its length, and by its diameter's tolerance if it has one."""
    length = length_m / INCH
    counts = [OTHERWISE, section_points(feature)]
    counts += [math.ceil(length - 1e-9)] if length < 5 else []
    counts += [5] if length > 5 else []
    return max(counts)


def section_points(feature: Feature) -> int:
    """Points on each cross-section, by the tolerance of the diameter; 0 if it has none."""
    tolerance = feature.tolerances.get("Diameter", math.inf) / INCH
    return next((count for limit, count in DIAMETER_POINTS if tolerance < limit), 0)
