# cython: language_level=3, annotation_typing=False, infer_types=True, boundscheck=False, wraparound=False
# cython: initializedcheck=False, cdivision=True
"""Sine and cosine with the same bits on every processor, which those of the C library need not have.

The angle is reduced to an eighth of a turn around 0 (Cody & Waite 1980); the polynomials are those of FDLIBM (Sun 1993). The
error is below 1e-15 for angles of up to a million turns; with larger ones, the library's are taken.
"""

import math

LARGE = 6e6  # rad
SHIFT = 6755399441055744.0  # 1.5 * 2^52: adding it rounds
FIRST, SECOND, THIRD = 1.57079632673412561417e00, 6.07710050630396597660e-11, 2.02226624879595063154e-21


def sine_cosine(x: float) -> tuple[float, float]:
    """Sine and cosine of an angle in rad."""
    if not -LARGE <= x <= LARGE:
        return (math.sin(x), math.cos(x))
    n = (x * 0.63661977236758134308 + SHIFT) - SHIFT
    r = ((x - n * FIRST) - n * SECOND) - n * THIRD
    z = r * r
    s = -2.50507602534068634195e-08 + z * 1.58969099521155010221e-10
    s = -1.98412698298579493134e-04 + z * (2.75573137070700676789e-06 + z * s)
    s = r + r * z * (-1.66666666666666324348e-01 + z * (8.33333333332248946124e-03 + z * s))
    c = 2.08757232129817482790e-09 - z * 1.13596475577881948265e-11
    c = 2.48015872894767294178e-05 + z * (-2.75573143513906633035e-07 + z * c)
    c = 1.0 - (0.5 * z - z * z * (4.16666666666666019037e-02 + z * (-1.38888888888741095749e-03 + z * c)))
    half = n * 0.5
    whole = (half + SHIFT) - SHIFT  # n is even if this is its half
    odd = whole != half
    back = (((n - 1.0 if odd else n) * 0.25 + SHIFT) - SHIFT) * 4.0 != (n - 1.0 if odd else n)
    if odd:
        s, c = c, -s
    return (-s, -c) if back else (s, c)
