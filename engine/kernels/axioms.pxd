# The types with which Cython compiles axioms.py. That file says what they mean.
import cython

@cython.final
cdef class Closure:
    cdef int rules, depth, first, last
    cdef int[::1] heads, layers, needed, derived, user_starts, user_items, atom_starts, atom_items, other_items
    cdef int[::1] watched, missing, queue
    cdef readonly int[::1] by

    @cython.locals(after=bytearray)
    cpdef bytes close(self, const unsigned char[::1] state)

    @cython.locals(rule=int, layer=int)
    cpdef void complete(self, unsigned char[::1] after) noexcept

    @cython.locals(place=int, atom=int, rule=int)
    cdef void _begin(self, unsigned char[::1] after) noexcept

    @cython.locals(place=int, atom=int, other=int)
    cdef void _negate(self, int layer, unsigned char[::1] after) noexcept

    cdef void _note(self, int atom) noexcept

    @cython.locals(head=int)
    cdef void _fire(self, int rule, unsigned char[::1] after) noexcept

    @cython.locals(atom=int, place=int, rule=int)
    cdef void _spread(self, int layer, unsigned char[::1] after) noexcept

@cython.final
cdef class Upkeep:
    cdef int depth, width, last, current
    cdef int[::1] heads, layers, user_starts, user_items, head_starts, head_items, atom_starts, atom_items, other_items
    cdef int[::1] recursive, dirty, watched, missing, reasons, queue
    cdef unsigned char[::1] mask, known

    @cython.locals(place=int, atom=int, layer=int)
    cpdef void complete(self, unsigned char[::1] after) noexcept

    cdef bint _holds(self, int atom) noexcept

    @cython.locals(true=bint, place=int, rule=int, met=bint)
    cdef void _flip(self, int atom) noexcept

    cdef void _note(self, int atom) noexcept

    @cython.locals(place=int, atom=int)
    cdef void _settle(self, int layer) noexcept

    @cython.locals(place=int, first=int, atom=int)
    cdef void _spread(self, int layer) noexcept
