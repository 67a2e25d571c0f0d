# Types with which Cython compiles hierarchy.py. Its meaning is written there.
import cython

cpdef enum:
    LEAF = -1

@cython.final
cdef class Hierarchy:
    cdef readonly object boxes, children
    cdef readonly Py_ssize_t root, depth, numbers
    cdef const double[:, ::1] _boxes
    cdef const long long[:, ::1] _children
    cdef long long[::1] _level

@cython.locals(k=Py_ssize_t)
cdef bint _sound(Hierarchy h) noexcept

@cython.final
cdef class Plan:
    cdef const double[:, ::1] leaves
    cdef const long long[::1] numbers
    cdef double[:, ::1] boxes
    cdef long long[:, ::1] children, open
    cdef long long[::1] order

@cython.locals(p=Plan, count=Py_ssize_t)
cpdef void build(object leaves, object numbers, object boxes, object children) except *
@cython.locals(size=Py_ssize_t, free="long long", x=Py_ssize_t)
cdef void _divide(Plan p, Py_ssize_t count) noexcept nogil
cdef double _middle(Plan p, Py_ssize_t at, Py_ssize_t axis) noexcept nogil
@cython.locals(best=Py_ssize_t, axis=Py_ssize_t, at=Py_ssize_t, low=double, high=double, middle=double)
cdef Py_ssize_t _longest(Plan p, Py_ssize_t first, Py_ssize_t after) noexcept nogil
@cython.locals(i=Py_ssize_t, j=Py_ssize_t, kept="long long")
cdef void _select(Plan p, Py_ssize_t low, Py_ssize_t high, Py_ssize_t wanted, Py_ssize_t axis) noexcept nogil
@cython.locals(row=Py_ssize_t, x=Py_ssize_t)
cdef void _unite(Plan p) noexcept nogil

@cython.final
cdef class Change:
    cdef Hierarchy h
    cdef const double[::1] box
    cdef Py_ssize_t number, used
    cdef readonly object boxes, children
    cdef double[:, ::1] _new_boxes
    cdef long long[:, ::1] _new_children
    cdef long long[::1] path, open, levels

cdef Py_ssize_t _add_leaf(Change c) noexcept
cdef double _corner(Change c, Py_ssize_t node, Py_ssize_t x) noexcept
@cython.locals(x=Py_ssize_t)
cdef Py_ssize_t _add_node(Change c, Py_ssize_t one, Py_ssize_t other) noexcept
@cython.locals(up=Py_ssize_t)
cdef Py_ssize_t _rise(Change c, Py_ssize_t level, Py_ssize_t below) noexcept
@cython.locals(node=Py_ssize_t, level=Py_ssize_t)
cdef Py_ssize_t _way_in(Change c) noexcept
@cython.locals(grown=double, away=double, low=double, high=double, x=Py_ssize_t)
cdef double _growth(Change c, Py_ssize_t node) noexcept
@cython.locals(size=Py_ssize_t, child="long long")
cdef Py_ssize_t _way_to(Change c) noexcept
@cython.locals(x=Py_ssize_t)
cdef bint _holds(Change c, Py_ssize_t node) noexcept
