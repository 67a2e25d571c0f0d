# Types with which Cython compiles meeting.py. Its meaning is written there.
import cython

cdef double SHORT

@cython.final
cdef class Blocks:
    cdef const double[:, ::1] middle, half
    cdef double[:, ::1] local, corner, edge
    cdef Py_ssize_t count

@cython.locals(
    n=Py_ssize_t, m=Py_ssize_t, i=Py_ssize_t, k=Py_ssize_t,
    frames="const double[:, :, ::1]", corners="const double[:, :, ::1]", out="unsigned char[::1]"
)
cpdef meeting(Blocks blocks, poses, triangles)
@cython.locals(c=int, x=int, y=int, j=Py_ssize_t, hit=bint)
cdef bint _any(
    Blocks b, const double[:, :, ::1] frames, Py_ssize_t i, const double[:, :, ::1] corners, Py_ssize_t k
) noexcept nogil
@cython.locals(c=int, x=int, low=double, high=double)
cdef bint _near(Blocks b, Py_ssize_t j) noexcept nogil
@cython.locals(c=int, n=int, x=int, y=int, z=int, height=double, reach=double, normal=double)
cdef bint _separated(Blocks b, Py_ssize_t j) noexcept nogil
@cython.locals(
    y=int, z=int, p=double, q=double, first=double, second=double, third=double, reach=double
)
cdef bint _beyond(Blocks b, Py_ssize_t j, int c, int x) noexcept nogil
