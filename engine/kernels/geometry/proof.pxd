# Types with which Cython compiles proof.py. Its meaning is written there.
import cython
from libc cimport math
from cellwright.engine.kernels.geometry cimport checks, edges, layout, mechanism, room, volumes
from cellwright.engine.kernels.geometry.lanes cimport Lanes, Narrow
from cellwright.engine.kernels.geometry.layout cimport Pairs
from cellwright.engine.kernels.geometry.mechanism cimport Mechanism
from cellwright.engine.kernels.geometry.room cimport Room

cdef int LANES, DEEPEST
cdef double LONGEST

@cython.final
cdef class Proof:
    cdef readonly Py_ssize_t count
    cdef readonly long long looked, refined, pair
    cdef readonly double where, shortest
    cdef double margin, finest
    cdef Mechanism mechanism
    cdef Pairs pairs
    cdef Room room
    cdef Lanes lanes
    cdef const double[:, ::1] reach
    cdef double[:, :, :, ::1] poses
    cdef double[:, ::1] todo, now
    cdef double[::1] at, half, whole
    cdef Py_ssize_t latest

@cython.locals(a="const double[:, ::1]", n=Py_ssize_t, free=bint)
cpdef Py_ssize_t proved(Proof p, object path) except -1
@cython.locals(
    away=double, level=double, first=double, half=double, size=Py_ssize_t, taken=int, lane=int, failed="unsigned int"
)
cdef bint _line_proved(Proof p, const double[:, ::1] a, Py_ssize_t n) noexcept nogil
@cython.locals(x=Py_ssize_t, i=Py_ssize_t)
cdef void _measure(Proof p, const double[:, ::1] a, Py_ssize_t n) noexcept nogil
@cython.locals(i=Py_ssize_t, most=double)
cdef bint _finest(Proof p, double share) noexcept nogil
@cython.locals(lane=int, row=int, x=Py_ssize_t, g=Py_ssize_t, failed="unsigned int")
cdef unsigned int _failed(Proof p, int taken) noexcept nogil
@cython.locals(x=Py_ssize_t, g=Py_ssize_t)
cdef bint _near_in(Proof p, int lane) noexcept nogil
@cython.locals(m=Py_ssize_t, i=Py_ssize_t, j=Py_ssize_t, by=double, said=int)
cdef long long _near(Proof p, Py_ssize_t g, double share) noexcept nogil
@cython.locals(total=double, x=Py_ssize_t)
cdef double _motion(Proof p, Py_ssize_t i, Py_ssize_t j, double share) noexcept nogil
