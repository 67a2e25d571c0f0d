# Types with which Cython compiles proof.py. Its meaning is written there.
import cython
from libc cimport math
from engine.kernels.geometry cimport checks, edges, layout, room, volumes
from engine.kernels.geometry.edges cimport Mechanism
from engine.kernels.geometry.layout cimport Pairs, Pieces
from engine.kernels.geometry.room cimport Room

@cython.final
cdef class Proof:
    cdef readonly Py_ssize_t count
    cdef readonly long long looked, refined, pair
    cdef readonly double where
    cdef double margin, finest
    cdef Mechanism mechanism
    cdef Pairs pairs
    cdef Room room
    cdef const double[:, ::1] reach
    cdef double[:, :, :, ::1] poses
    cdef double[::1] at, half, whole
    cdef Py_ssize_t latest

@cython.locals(a="const double[:, ::1]", n=Py_ssize_t, free=bint)
cpdef Py_ssize_t proved(Proof p, object path) except -1
@cython.locals(least=double, low=double, level=double, most=double)
cdef bint _line_proved(Proof p, const double[:, ::1] a, Py_ssize_t n) noexcept nogil
@cython.locals(x=Py_ssize_t, i=Py_ssize_t, most=double)
cdef double _stand_at(Proof p, const double[:, ::1] a, Py_ssize_t n, double t, double half) noexcept nogil
@cython.locals(g=Py_ssize_t, first=Py_ssize_t)
cdef bint _apart(Proof p) noexcept nogil
@cython.locals(m=Py_ssize_t, i=Py_ssize_t, j=Py_ssize_t, by=double, said=int)
cdef long long _near(Proof p, Py_ssize_t g) noexcept nogil
@cython.locals(total=double, x=Py_ssize_t)
cdef double _motion(Proof p, Py_ssize_t i, Py_ssize_t j) noexcept nogil
