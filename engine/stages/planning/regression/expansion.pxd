# Types with which Cython compiles expansion.py. Its meaning is written there.
import cython

from cellwright.engine.kernels.bits cimport indices
from cellwright.engine.stages.planning.relaxed_plans cimport RelaxedPlans

cdef object UNKNOWN

@cython.final
cdef class Operators:
    cdef readonly list achievers, adds, preconditions, conflicts, charges, lightness, excluded

    @cython.locals(number="Py_ssize_t", atom="Py_ssize_t")
    cpdef void add(self, object preconditions, object adds, object deletes, object charge)

    @cython.locals(atom="Py_ssize_t")
    cpdef bint consistent(self, object conditions)

    @cython.locals(atom="Py_ssize_t")
    cdef object _conflicting(self, object preconditions, object adds, object deletes)

@cython.final
cdef class Expansion:
    cdef Operators _operators
    cdef RelaxedPlans _relaxed
    cdef object _initial
    cdef list _needs

    @cython.locals(atom="Py_ssize_t", place="Py_ssize_t", unsatisfied=list, plans=list, after=list, found=list, several=set)
    cpdef list successors(self, object open_, long long room)

    @cython.locals(number="Py_ssize_t", charge="long long", estimate="long long", achievers=list)
    cdef void _achieve(self, list found, object open_, Py_ssize_t atom, object lightness, object others, long long room, set several)
