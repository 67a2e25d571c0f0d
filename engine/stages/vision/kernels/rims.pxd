# Types with which Cython compiles rims.py. Its meaning is written there.
import cython
from libc cimport math

cdef long long AROUND, SQUARE
cdef double UNKNOWN

@cython.locals(inside="const unsigned char[:, ::1]")
cpdef border(mask)
@cython.locals(count=Py_ssize_t, height=Py_ssize_t, width=Py_ssize_t, u=Py_ssize_t, v=Py_ssize_t)
cdef Py_ssize_t _border(const unsigned char[:, ::1] inside, double[:, ::1] places, double[:, ::1] ways) noexcept nogil
cdef bint _ends(const unsigned char[:, ::1] inside, Py_ssize_t u, Py_ssize_t v) noexcept nogil
@cython.locals(across="long long", down="long long", x=Py_ssize_t, y=Py_ssize_t, length=double)
cdef bint _outward(
    const unsigned char[:, ::1] inside, Py_ssize_t u, Py_ssize_t v, double[:, ::1] ways, Py_ssize_t row
) noexcept nogil
@cython.locals(count=Py_ssize_t, u0=Py_ssize_t, v0=Py_ssize_t)
cpdef ends(inverse, planes, at, outward, Py_ssize_t reach, double tolerance_m, depth, owner, corner)
@cython.locals(
    n=Py_ssize_t, on=Py_ssize_t, near=Py_ssize_t, first=Py_ssize_t, step=Py_ssize_t, deeper=bint, u=double, v=double, apart=double,
    own="long long", other="long long"
)
cdef void _ended(
    const double[:, ::1] inverse, const double[:, ::1] planes, const double[:, ::1] at, const double[:, ::1] outward,
    Py_ssize_t reach, double tolerance_m, const double[:, ::1] depth, const long long[:, ::1] owner, Py_ssize_t u0, Py_ssize_t v0,
    double[::1] shift, unsigned char[::1] goes_on
) noexcept nogil
@cython.locals(row=Py_ssize_t, column=Py_ssize_t)
cdef long long _owner(const long long[:, ::1] owner, double u, double v) noexcept nogil
@cython.locals(w=double, row=Py_ssize_t, column=Py_ssize_t)
cdef double _deeper(
    const double[:, ::1] inverse, const double[:, ::1] depth, double u, double v, Py_ssize_t u0, Py_ssize_t v0
) noexcept nogil
@cython.locals(w=double, expected=double, above=double, row=Py_ssize_t, column=Py_ssize_t)
cdef double _apart(
    const double[:, ::1] inverse, const double[:, ::1] planes, Py_ssize_t n, double u, double v
) noexcept nogil
