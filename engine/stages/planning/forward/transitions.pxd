# The types with which Cython compiles transitions.py. That file says what they mean.
import cython

from cellwright.engine.kernels.axioms cimport Upkeep
from cellwright.engine.kernels.sums cimport Comparisons, Repetitions
from cellwright.engine.kernels.packed_rows cimport PackedRows

cdef long long LARGEST, TABLE

@cython.final
cdef class Changes:
    cdef PackedRows of, parts, touched
    cdef int[::1] targets, sources
    cdef long long[::1] constants, factors

@cython.final
cdef class Transitions:
    cdef readonly int width, done
    cdef int turn
    cdef int[::1] stamps, closes
    cdef PackedRows needs, of, conditions, adds, deletes, cancels
    cdef Changes changes
    cdef Comparisons comparisons
    cdef Upkeep upkeep

    @cython.locals(row="unsigned char[::1]")
    cpdef bytes after(self, bytes state, int operator, long long times)

    @cython.locals(place=int, atom=int)
    cdef bint _applicable(self, int operator, const unsigned char[::1] state) noexcept

    @cython.locals(place=int, atom=int)
    cdef bint _fires(self, int effect, const unsigned char[::1] before) noexcept

    @cython.locals(index=int)
    cdef void _apply(self, int operator, const unsigned char[::1] before, unsigned char[::1] found) noexcept

    @cython.locals(place=int, atom=int)
    cdef void _delete(self, int effect, unsigned char[::1] found) noexcept

    @cython.locals(place=int, atom=int)
    cdef void _add(self, int effect, unsigned char[::1] found) noexcept

    @cython.locals(first=int, last=int, index=int, change=int, place=int, part=int, total="long long", row="unsigned char[::1]", old="const long long[::1]", new="long long[::1]")
    cdef bint _change(self, int operator, bytes before, bytearray found)

@cython.final
cdef class Dominance:
    cdef readonly int resources
    cdef int width, count
    cdef unsigned char[::1] fluents
    cdef int[::1] signs

    @cython.locals(place=int, number=int, found=bytearray, row="unsigned char[::1]")
    cpdef bytes rest(self, bytes state)

    @cython.locals(place=int, number=int, start="Py_ssize_t", size="Py_ssize_t", values="const long long[::1]", row="long long[::1]", view="long long[::1]")
    cpdef bint dominated(self, bytes state, object front)

@cython.final
cdef class Novelty:
    cdef int width, quantities
    cdef long long[::1] atoms, values

    @cython.locals(new=int, worse=int, atom=int, best="long long", number=int, place="long long", row="const unsigned char[::1]", numbers="const long long[::1]")
    cpdef int rank(self, bytes state, long long estimate)

@cython.final
cdef class Distance:
    cdef int width, count
    cdef int[::1] goals, starts
    cdef Repetitions repetitions

    @cython.locals(total="long long", least="long long", goal=int, atom=int, place=int, found="long long[::1]", row="const unsigned char[::1]")
    cpdef long long of(self, bytes state)
