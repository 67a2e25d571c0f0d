# The types with which Cython compiles timeline.py. The docstrings are in that file.
import cython

from cellwright.engine.kernels.packed_rows cimport PackedRows
from cellwright.engine.stages.temporal.postfix_programs cimport PostfixPrograms
from cellwright.engine.stages.temporal.temporal_network cimport TemporalNetwork

cdef double TOLERANCE

@cython.final
cdef class Timeline(TemporalNetwork):
    cdef readonly int facts, actions, numbers, cells, opened, passed
    cdef double scale
    cdef PackedRows needs, adds, deletes, holds, end_needs, end_adds, end_deletes, timed_adds, timed_deletes
    cdef PackedRows facts_read, numbers_read, end_facts_read, end_numbers_read
    cdef public int keeps_lags
    cdef PackedRows start_tests, hold_tests, end_tests, test_numbers, start_updates, end_updates, timed_updates
    cdef PackedRows update_reads
    cdef int[::1] names, last_start, last_end
    cdef int[::1] whole, instant, least_program, most_program, test_program, test_relation
    cdef int[::1] update_kind, update_number, update_program
    cdef long long[::1] least, most, timed_at
    cdef signed char[::1] initial
    cdef readonly signed char[::1] state
    cdef double[::1] values, update_value
    cdef readonly double[::1] amounts
    cdef PostfixPrograms programs
    cdef int[::1] adder, deleter, readers, holders, held, enders, due
    cdef int[::1] changer, changed_by_sum, number_readers, number_holders
    cdef readonly int[::1] open_at, open_start, open_end, open_list
    cdef int cell_room, first_added, last_added
    cdef int[::1] cell_node, cell_next, cell_start

    @cython.locals(fact=int, number=int, action=int, change=int, place=int, node=int)
    cpdef void reset(self)

    cdef void _grow_cells(self)

    @cython.locals(cell=int)
    cdef int _add_cell(self, int node, int start, int following)

    @cython.locals(cell=int, ender=int)
    cdef void _read_fact(self, int fact, int node)

    @cython.locals(place=int, fact=int)
    cdef void _read_choices(self, PackedRows facts, PackedRows numbers, int action, int node)

    @cython.locals(cell=int)
    cdef void _hold_fact(self, int fact, int start, int end)

    @cython.locals(cell=int)
    cdef void _delete_fact(self, int fact, int node)

    @cython.locals(cell=int)
    cdef void _add_fact(self, int fact, int node)

    @cython.locals(value=double, relation=int)
    cdef bint holds_test(self, int test) noexcept

    cdef void _read_number(self, int number, int node)
    cdef void _hold_number(self, int number, int start, int end)

    @cython.locals(cell=int, start=int, end=int, together=bint)
    cdef void _change_number(self, int number, int node, int is_sum)

    @cython.locals(place=int)
    cdef bint _is_open(self, int end) noexcept

    @cython.locals(place=int, test=int, index=int)
    cdef bint _check_tests(self, PackedRows lists, int row, int node)

    @cython.locals(first=int, last=int, place=int, update=int, program=int, index=int, number=int, kind=int, value=double)
    cdef void _apply_updates(self, PackedRows lists, int row, int node)

    @cython.locals(place=int, action=int, index=int)
    cdef bint _check_invariants(self) noexcept

    @cython.locals(place=int)
    cpdef bint applicable(self, int action)

    @cython.locals(place=int)
    cpdef bint can_end(self, int action)

    @cython.locals(done=bint)
    cpdef bint apply(self, int code)

    @cython.locals(value=double)
    cdef long long _length_of(self, int program) noexcept

    @cython.locals(start=int, end=int)
    cdef bint _start_action(self, int action)

    @cython.locals(place=int)
    cdef bint _apply_start(self, int action, int start)

    @cython.locals(least="long long", most="long long", start=int, end=int)
    cdef bint _add_instants(self, int action)

    @cython.locals(name=int)
    cdef void _follow_itself(self, int action, int start, int end)

    @cython.locals(place=int, test=int, index=int)
    cdef bint _hold_conditions(self, int action, int start, int end)

    @cython.locals(place=int)
    cdef void _read_length(self, int program, int node)

    @cython.locals(place=int, fact=int)
    cdef void _open_action(self, int action, int start, int end)

    @cython.locals(place=int, last=int)
    cdef void _close_action(self, int action)

    @cython.locals(cell=int, before=int)
    cdef void _remove_ender(self, int fact, int end) noexcept

    @cython.locals(place=int, end=int)
    cdef bint _end_action(self, int action)

    @cython.locals(place=int, node=int, fact=int, later=int, index=int)
    cdef bint _pass_change(self, int change)

    @cython.locals(total="long long", fact=int, place=int, number=int, action=int, value=double)
    cpdef long long digest(self)

    @cython.locals(mixed="unsigned long long")
    cdef long long _mix(self, long long value) noexcept
