# Types with which Cython compiles relaxed_plans.py. Its meaning is written there.
import cython

from cellwright.engine.kernels.bits cimport indices

cdef object UNKNOWN

@cython.final
cdef class RelaxedPlans:
    cdef readonly object initial
    cdef list _needs, _charges, _supporters, _plans, _own
    cdef object _bits

    @cython.locals(atom="Py_ssize_t")
    cpdef object plan(self, object goals)

    @cython.locals(last="Py_ssize_t", supporter="Py_ssize_t", need="Py_ssize_t", waiting=list, missing=list, needs=tuple, plans=list)
    cpdef object to(self, Py_ssize_t atom)

    @cython.locals(need="Py_ssize_t")
    cdef object _joined(self, Py_ssize_t supporter, tuple needs)
