# What vectors.py says, for Cython to copy into the modules that cimport it. Its meaning is written there.
from cellwright.engine.kernels.geometry cimport angles
from cellwright.engine.kernels.geometry.angles cimport Pair

ctypedef (double, double, double) Triple

cdef inline Triple vector(double x, double y, double z) noexcept nogil:
    return (x, y, z)

cdef inline double dot(Triple a, Triple b) noexcept nogil:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]

cdef inline Triple cross(Triple a, Triple b) noexcept nogil:
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])

cdef inline Triple minus(Triple a, Triple b) noexcept nogil:
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])

cdef inline Triple plus(Triple a, Triple b) noexcept nogil:
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])

cdef inline Triple times(double s, Triple a) noexcept nogil:
    return (s * a[0], s * a[1], s * a[2])

cdef inline Triple turn_by(Triple axis, double s, double c, Triple v) noexcept nogil:
    cdef double along = (1.0 - c) * dot(axis, v)
    cdef Triple around = cross(axis, v)
    return (
        c * v[0] + s * around[0] + along * axis[0],
        c * v[1] + s * around[1] + along * axis[1],
        c * v[2] + s * around[2] + along * axis[2],
    )

cdef inline Triple turn(Triple axis, double angle, Triple v) noexcept nogil:
    cdef Pair pair = angles.sine_cosine(angle)
    return turn_by(axis, pair[0], pair[1], v)
