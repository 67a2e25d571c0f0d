# Types with which Cython compiles invariant_loops.py. Its meaning is written there.
import cython

from cellwright.engine.kernels.bits cimport indices

@cython.final
cdef class Conserving:
    cdef object _initial
    cdef list _needs, _adds, _deletes, _conditional, _members, _added, _deleted
    cdef dict _adders

    @cython.locals(kind="Py_ssize_t", number="Py_ssize_t", best="Py_ssize_t", kinds=list, members=list)
    cpdef object broken_by(self, object group)

    @cython.locals(kind="Py_ssize_t", number="Py_ssize_t", best="Py_ssize_t", members=list)
    cpdef Py_ssize_t adding_without_taking(self, object group)

    @cython.locals(atom="Py_ssize_t", found=set)
    cdef list _adding(self, object group)

    cdef bint _keeps(self, object group, Py_ssize_t number)
