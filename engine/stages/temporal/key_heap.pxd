# The types with which Cython compiles key_heap.py. The docstrings are in that file.
import cython

@cython.final
cdef class KeyHeap:
    cdef public int size
    cdef int room
    cdef int[::1] heap
    cdef long long[::1] keys
    cdef object heap_kept, keys_kept

    cdef void _grow(self)

    @cython.locals(place=int, parent=int)
    cdef void push(self, int item, long long key)

    @cython.locals(place=int, child=int, key="long long", item=int)
    cdef void pop(self) noexcept
