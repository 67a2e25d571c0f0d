# cython: language_level=3, annotation_typing=False, infer_types=True, boundscheck=False
# cython: wraparound=False, initializedcheck=False, cdivision=True
"""Sine, cosine and arctangent with the same bits on every processor; those of libraries may differ.

An angle is reduced to an eighth of a turn around 0 (Cody & Waite 1980); the polynomials are those
of FDLIBM (Sun 1993). The error is below 1e-15 for angles of up to a million turns; with larger
ones, the C library's sine and cosine are taken.
"""

import math

import numpy as np

from cellwright.engine.kernels.arrays import Floats

LARGE = 6e6  # rad
SHIFT = 6755399441055744.0  # 1.5 * 2^52: adding it rounds
HALF_TURN, HALF_TURN_REST = 3.14159265358979311600e00, 1.22464679914735317720e-16
FIRST, SECOND, THIRD = (
    1.57079632673412561417e00,
    6.07710050630396597660e-11,
    2.02226624879595063154e-21,
)


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
    c = 1.0 - (
        0.5 * z - z * z * (4.16666666666666019037e-02 + z * (-1.38888888888741095749e-03 + z * c))
    )
    half = n * 0.5
    whole = (half + SHIFT) - SHIFT  # n is even if this is its half
    odd = whole != half
    back = (((n - 1.0 if odd else n) * 0.25 + SHIFT) - SHIFT) * 4.0 != (n - 1.0 if odd else n)
    if odd:
        s, c = c, -s
    return (-s, -c) if back else (s, c)


def angle_of(y: float, x: float) -> float:
    """The angle from the x axis to the point (x, y), in rad, from -pi to pi; 0 for the origin,
    NaN if that is no point.
    """
    wide, high = abs(x), abs(y)
    endless = (wide - wide) + (high - high)
    if endless != 0.0:
        return endless
    if wide == 0.0 and high == 0.0:
        return 0.0
    t = min(wide, high) / max(wide, high)
    angle, rest = 0.0, 0.0
    if t > 0.6875:
        t, angle, rest = (
            (t - 1.0) / (t + 1.0),
            7.85398163397448278999e-01,
            3.06161699786838301793e-17,
        )
    elif t > 0.4375:
        t, angle, rest = (
            (2.0 * t - 1.0) / (2.0 + t),
            4.63647609000806093515e-01,
            2.26987774529616870924e-17,
        )
    z = t * t
    w = z * z
    even = 4.97687799461593236017e-02 + w * 1.62858201153657823623e-02
    even = 9.09088713343650656196e-02 + w * (6.66107313738753120669e-02 + w * even)
    even = z * (3.33333333333329318027e-01 + w * (1.42857142725034663711e-01 + w * even))
    odd = -5.83357013379057348645e-02 - w * 3.65315727442169155270e-02
    odd = -1.11111104054623557880e-01 + w * (-7.69187620504482999495e-02 + w * odd)
    odd = w * (-1.99999999998764832476e-01 + w * odd)
    angle -= (t * (even + odd) - rest) - t
    if high > wide:
        angle = 0.5 * HALF_TURN - (angle - 0.5 * HALF_TURN_REST)
    if x < 0.0:
        angle = HALF_TURN - (angle - HALF_TURN_REST)
    return -angle if y < 0.0 else angle


def arc_cosine(x: float) -> float:
    """The angle from 0 to pi with this cosine, in rad. The cosine must be from -1 to 1."""
    return angle_of(math.sqrt((1.0 - x) * (1.0 + x)), x)


def sines_cosines(angles: Floats) -> tuple[Floats, Floats]:
    """Sines and cosines of angles (...), in rad."""
    x = np.array(angles, dtype=float, order="C")
    s, c = np.empty(x.shape), np.empty(x.shape)
    _fill(x.reshape(-1), s.reshape(-1), c.reshape(-1))
    return s, c


def unit_vectors(angles: Floats) -> Floats:
    """The points (..., 2) of the unit circle at angles (...), in rad."""
    s, c = sines_cosines(angles)
    return np.stack([c, s], axis=-1)


def angles_of(y: Floats, x: Floats) -> Floats:
    """The angles from the x axis to points (x, y) given as arrays (...), in rad, from -pi to pi."""
    ys, xs = np.broadcast_arrays(np.asarray(y, dtype=float), np.asarray(x, dtype=float))
    found = np.empty(ys.shape)
    _fill_angles(
        np.ascontiguousarray(ys).reshape(-1),
        np.ascontiguousarray(xs).reshape(-1),
        found.reshape(-1),
    )
    return found


def _fill(x: Floats, s: Floats, c: Floats) -> None:
    for n in range(x.shape[0]):
        pair = sine_cosine(x[n])
        s[n], c[n] = pair[0], pair[1]


def _fill_angles(y: Floats, x: Floats, found: Floats) -> None:
    for n in range(y.shape[0]):
        found[n] = angle_of(y[n], x[n])
