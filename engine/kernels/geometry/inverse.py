"""Closed-form inverse kinematics of six revolute axes, one pose after the other, all eight branches.

The arm is given at its zero configuration: unit axes h (6, 3) and a point o (6, 3) on each. The target is
E = T(q) T(0)^-1, so E = exp(h1, o1, q1) ... exp(h6, o6, q6). The angles fall out of two canonical problems in turn:
turning a vector onto another (Paden 1986, subproblem 1) and turning it until it meets a plane (Elias & Wen 2022,
subproblem 4; the distance problem, 3, is the same equation). No axis needs to meet the base axis, and the three wrist
axes may stand at any angles, so that orthogonal and three-roll wrists are one case.
"""

import math

from engine.kernels.arrays import Floats
from engine.kernels.geometry import compiled
from engine.kernels.geometry.vectors import V, cross, dot, minus, plus, times, turn

SLACK = 1e-7  # how far beyond a limit a cosine may lie; Newton's method repairs or the residual rejects it


@compiled
def angle_onto(axis: V, start: V, end: V) -> float:
    """The angle that turns `start` onto `end` about `axis`, as nearly as it can; 0 when either lies along the axis."""
    p = minus(start, times(dot(axis, start), axis))
    q = minus(end, times(dot(axis, end), axis))
    scale = dot(p, p) * dot(q, q)
    if scale < 1e-32:
        return 0.0
    return math.atan2(dot(axis, cross(p, q)), dot(p, q))


@compiled
def angles_to_plane(normal: V, axis: V, start: V, offset: float) -> V:
    """Both angles at which `start`, turned about `axis`, has `normal . start == offset`, then 1 if there are any, or 0."""
    along = dot(normal, axis) * dot(axis, start)
    a = dot(normal, start) - along
    b = dot(normal, cross(axis, start))
    amplitude = math.hypot(a, b)
    if amplitude < 1e-14:
        return (0.0, 0.0, 1.0 if abs(offset - along) < 1e-9 else 0.0)
    cosine = (offset - along) / amplitude
    if abs(cosine) > 1.0 + SLACK:
        return (0.0, 0.0, 0.0)
    spread = math.acos(min(1.0, max(-1.0, cosine)))
    middle = math.atan2(b, a)
    return (middle + spread, middle - spread, 1.0)


@compiled
def row(matrix: Floats, index: int) -> V:
    """Row `index` of an (n, 3) array."""
    return (matrix[index, 0], matrix[index, 1], matrix[index, 2])


@compiled
def rotate(E: Floats, v: V) -> V:
    """The rotation in E (4, 4) applied to `v`."""
    return (
        E[0, 0] * v[0] + E[0, 1] * v[1] + E[0, 2] * v[2],
        E[1, 0] * v[0] + E[1, 1] * v[1] + E[1, 2] * v[2],
        E[2, 0] * v[0] + E[2, 1] * v[1] + E[2, 2] * v[2],
    )


@compiled
def rotate_back(E: Floats, v: V) -> V:
    """The inverse rotation in E (4, 4) applied to `v`."""
    return (
        E[0, 0] * v[0] + E[1, 0] * v[1] + E[2, 0] * v[2],
        E[0, 1] * v[0] + E[1, 1] * v[1] + E[2, 1] * v[2],
        E[0, 2] * v[0] + E[1, 2] * v[1] + E[2, 2] * v[2],
    )


@compiled
def moved(E: Floats, v: V) -> V:
    """The point `v` displaced by E (4, 4)."""
    return plus(rotate(E, v), (E[0, 3], E[1, 3], E[2, 3]))


@compiled
def spherical_wrist(h: Floats, o: Floats, centre: V, poses: Floats, q: Floats, valid: Floats) -> None:
    """Axes 2 and 3 parallel, axes 4 to 6 through `centre`. Fills q (n, 8, 6), valid (n, 8) with 1 or 0."""
    h1, h2, h3, o1, o2, o3 = row(h, 0), row(h, 1), row(h, 2), row(o, 0), row(o, 1), row(o, 2)
    upper, fore = minus(o3, o2), minus(centre, o3)
    reach = (dot(upper, upper), dot(fore, fore))
    for n in range(poses.shape[0]):
        E = poses[n]
        target = minus(moved(E, centre), o1)
        first = angles_to_plane(h2, times(-1.0, h1), target, dot(h2, minus(centre, o1)))
        for i in range(2):
            end = minus(turn(h1, -first[i], target), minus(o2, o1))
            third = angles_to_plane(upper, h3, fore, (dot(end, end) - reach[0] - reach[1]) / 2.0)
            for j in range(2):
                second = angle_onto(h2, plus(upper, turn(h3, third[j], fore)), end)
                branch = 4 * i + 2 * j
                for b in (branch, branch + 1):
                    q[n, b, 0], q[n, b, 1], q[n, b, 2] = first[i], second, third[j]
                solved = _wrist(h, E, q[n], branch)
                valid[n, branch] = valid[n, branch + 1] = first[2] * third[2] * solved


@compiled
def _wrist(h: Floats, E: Floats, q: Floats, branch: int) -> float:
    """Fill the last three joints of two branches whose first three are known; whether the wrist can turn so far."""
    h4, h5, h6 = row(h, 3), row(h, 4), row(h, 5)
    tool = _back(h, q[branch], rotate(E, h6))  # R36 h6
    fifth = angles_to_plane(h4, h5, h6, dot(h4, tool))
    aside = _across(h6)
    turned = _back(h, q[branch], rotate(E, aside))  # R36 aside
    for k in range(2):
        fourth = angle_onto(h4, turn(h5, fifth[k], h6), tool)
        sixth = angle_onto(h6, aside, turn(h5, -fifth[k], turn(h4, -fourth, turned)))
        q[branch + k, 3], q[branch + k, 4], q[branch + k, 5] = fourth, fifth[k], sixth
    return fifth[2]


@compiled
def _back(h: Floats, q: Floats, v: V) -> V:
    """`v` seen after the first three joints."""
    return turn(row(h, 2), -q[2], turn(row(h, 1), -q[1], turn(row(h, 0), -q[0], v)))


@compiled
def _across(axis: V) -> V:
    """Some vector that is not along `axis`, at right angles to it."""
    if abs(axis[0]) < 0.6:
        return cross(axis, (1.0, 0.0, 0.0))
    return cross(axis, (0.0, 1.0, 0.0))


@compiled
def parallel_axes(h: Floats, o: Floats, centre: V, poses: Floats, q: Floats, valid: Floats) -> None:
    """Axes 2, 3 and 4 parallel, axes 5 and 6 through `centre`. Fills q (n, 8, 6), valid (n, 8) with 1 or 0."""
    h1, h2, o1 = row(h, 0), row(h, 1), row(o, 0)
    for n in range(poses.shape[0]):
        E = poses[n]
        target = minus(moved(E, centre), o1)
        first = angles_to_plane(h2, times(-1.0, h1), target, dot(h2, minus(centre, o1)))
        for i in range(2):
            wrist = turn(h1, -first[i], target)
            tool = turn(h1, -first[i], rotate(E, row(h, 5)))
            fifth = angles_to_plane(h2, row(h, 4), row(h, 5), dot(h2, tool))
            for k in range(2):
                branch = 4 * i + 2 * k
                for b in (branch, branch + 1):
                    q[n, b, 0], q[n, b, 4] = first[i], fifth[k]
                solved = _elbow(h, o, centre, wrist, E, q[n], branch)
                valid[n, branch] = valid[n, branch + 1] = first[2] * fifth[2] * solved


@compiled
def _elbow(h: Floats, o: Floats, centre: V, wrist: V, E: Floats, q: Floats, branch: int) -> float:
    """Fill joints 2, 3, 4 and 6 of two branches whose joints 1 and 5 are known; whether the arm is long enough."""
    h2, h5, h6 = row(h, 1), row(h, 4), row(h, 5)
    q1, q5 = q[branch, 0], q[branch, 4]
    whole, palm = minus(wrist, minus(row(o, 1), row(o, 0))), minus(centre, row(o, 3))
    parallel = turn(h5, -q5, h2)
    beside = cross(parallel, h6)
    if dot(beside, beside) > 1e-13:
        # h2^T R1^T R06 = h2^T R5 R6, so that R6 turns R06^T R1 h2 onto R5^T h2
        sixth = angle_onto(h6, rotate_back(E, turn(row(h, 0), q1, h2)), parallel)
        aside = _across(h2)
        seen = turn(h6, -sixth, turn(h5, -q5, aside))
        total = angle_onto(h2, aside, turn(row(h, 0), -q1, rotate(E, seen)))  # q2 + q3 + q4 about h2
    else:  # axis 6 is parallel to axis 4: of the continuum the hand that reaches farthest
        total = angle_onto(h2, palm, whole)
        aside = _across(h6)
        seen = turn(h2, -total, turn(row(h, 0), -q1, rotate(E, aside)))
        sixth = angle_onto(h6, aside, turn(h5, -q5, seen))
    end = minus(whole, turn(h2, total, palm))
    upper, fore = minus(row(o, 2), row(o, 1)), minus(row(o, 3), row(o, 2))
    third = angles_to_plane(
        upper, row(h, 2), fore, (dot(end, end) - dot(upper, upper) - dot(fore, fore)) / 2.0
    )
    for j in range(2):
        second = angle_onto(h2, plus(upper, turn(row(h, 2), third[j], fore)), end)
        rest = total - second - dot(h2, row(h, 2)) * third[j]
        q[branch + j, 1], q[branch + j, 2] = second, third[j]
        q[branch + j, 3], q[branch + j, 5] = dot(h2, row(h, 3)) * rest, sixth
    return third[2]


@compiled
def residuals(h: Floats, o: Floats, poses: Floats, q: Floats, valid: Floats, out: Floats) -> None:
    """How far each valid branch misses E, in metres and radians alike: out (n, 8), infinite where not valid."""
    for n in range(poses.shape[0]):
        for b in range(q.shape[1]):
            out[n, b] = math.inf
            if valid[n, b] > 0.0:
                out[n, b] = _residual(h, o, poses[n], q[n, b])


@compiled
def _residual(h: Floats, o: Floats, E: Floats, q: Floats) -> float:
    """The largest error of the images of the origin and of three unit steps from it."""
    worst = 0.0
    for c in range(4):
        point = (1.0 if c == 0 else 0.0, 1.0 if c == 1 else 0.0, 1.0 if c == 2 else 0.0)
        wanted = moved(E, point)
        for joint in range(5, -1, -1):
            about = row(o, joint)
            point = plus(about, turn(row(h, joint), q[joint], minus(point, about)))
        missed = minus(point, wanted)
        worst = max(worst, abs(missed[0]), abs(missed[1]), abs(missed[2]))
    return worst
