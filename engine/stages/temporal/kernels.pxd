# The types with which Cython compiles kernels.py. The docstrings are in that file.
import cython

from cellwright.engine.kernels.cancellation cimport Poll

cdef long long UNREACHED, MOST, NO_GOAL
cdef double NEAR

@cython.final
cdef class Lists:
    cdef readonly int count, length
    cdef readonly int[::1] starts, items

@cython.final
cdef class Heap:
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

@cython.final
cdef class Programs:
    cdef Lists signs, values
    cdef double[::1] constants, stack

    @cython.locals(size=int, place=int, sign=int, index=int)
    cdef double value(self, int program, double[::1] numbers) noexcept

    @cython.locals(one=double, two=double)
    cdef void _calculate(self, int sign, int size) noexcept

@cython.final
cdef class Timeline:
    cdef readonly int facts, actions, numbers, changes, nodes, edges, cells, opened, passed
    cdef readonly long long epsilon, makespan
    cdef double scale
    cdef readonly bint consistent
    cdef Lists needs, adds, deletes, holds, end_needs, end_adds, end_deletes, timed_adds, timed_deletes
    cdef Lists start_tests, hold_tests, end_tests, test_numbers, start_updates, end_updates, timed_updates
    cdef Lists update_reads
    cdef int[::1] whole, instant, least_program, most_program, test_program, test_relation
    cdef int[::1] update_kind, update_number, update_program
    cdef long long[::1] least, most, timed_at
    cdef signed char[::1] initial
    cdef readonly signed char[::1] state
    cdef double[::1] values, update_value
    cdef readonly double[::1] amounts
    cdef Programs programs
    cdef int[::1] adder, deleter, readers, holders, held, enders, due
    cdef int[::1] changer, changed_by_sum, number_readers, number_holders
    cdef readonly int[::1] open_at, open_start, open_end, open_list
    cdef int node_room, edge_room, cell_room
    cdef readonly long long[::1] times
    cdef long long[::1] edge_gap
    cdef int[::1] out, queue, queued, edge_to, edge_next, cell_node, cell_next, cell_start

    @cython.locals(fact=int, number=int, action=int, change=int, place=int, node=int)
    cpdef void reset(self)

    @cython.locals(node=int)
    cdef int _node(self)

    cdef void _grow_nodes(self)
    cdef void _grow_edges(self)
    cdef void _grow_cells(self)

    @cython.locals(cell=int)
    cdef int _cell(self, int node, int start, int following)

    @cython.locals(edge=int)
    cdef void _edge(self, int before, int after, long long gap)

    @cython.locals(head=int, size=int, room=int, node=int, edge=int, after=int, time="long long", place=int)
    cdef void _propagate(self, int first, int source) noexcept

    @cython.locals(cell=int, ender=int)
    cdef void _read(self, int fact, int node)

    @cython.locals(cell=int)
    cdef void _hold(self, int fact, int start, int end)

    @cython.locals(cell=int)
    cdef void _delete(self, int fact, int node)

    @cython.locals(cell=int)
    cdef void _add(self, int fact, int node)

    @cython.locals(value=double, relation=int)
    cdef bint _tested(self, int test) noexcept

    cdef void _read_number(self, int number, int node)
    cdef void _hold_number(self, int number, int start, int end)

    @cython.locals(cell=int, start=int, end=int, together=bint)
    cdef void _change_number(self, int number, int node, int is_sum)

    @cython.locals(place=int)
    cdef bint _is_open(self, int end) noexcept

    @cython.locals(place=int, test=int, index=int)
    cdef bint _tests(self, Lists lists, int row, int node)

    @cython.locals(first=int, last=int, place=int, update=int, program=int, index=int, number=int, kind=int, value=double)
    cdef void _update(self, Lists lists, int row, int node)

    @cython.locals(place=int, action=int, index=int)
    cdef bint _invariants(self) noexcept

    @cython.locals(place=int)
    cpdef bint applicable(self, int action)

    @cython.locals(place=int)
    cpdef bint can_end(self, int action)

    @cython.locals(done=bint)
    cpdef bint apply(self, int code)

    @cython.locals(value=double)
    cdef long long _length(self, int program) noexcept

    @cython.locals(least="long long", most="long long", start=int, end=int, place=int, test=int, index=int)
    cdef bint _start(self, int action)

    @cython.locals(place=int)
    cdef void _read_length(self, int program, int node)

    @cython.locals(place=int, fact=int)
    cdef void _open(self, int action, int start, int end)

    @cython.locals(place=int, last=int)
    cdef void _close(self, int action)

    @cython.locals(cell=int, before=int)
    cdef void _unlist(self, int fact, int end) noexcept

    @cython.locals(place=int, end=int)
    cdef bint _end(self, int action)

    @cython.locals(place=int, node=int, fact=int, later=int, index=int)
    cdef bint _pass(self, int change)

    @cython.locals(total="long long", fact=int, place=int, number=int, value=double)
    cpdef long long digest(self)

    @cython.locals(mixed="unsigned long long")
    cdef long long _mixed(self, long long value) noexcept

@cython.final
cdef class Relaxation:
    cdef readonly int all_facts, facts, actions, operators, first_test, changes, fitting, helping, length
    cdef readonly long long estimate
    cdef public double slope
    cdef Lists open_adds, relaxed_needs, early_adds, late_adds, users, nudges, timed_adds, no_needs
    cdef public Lists goals
    cdef long long[::1] spans, timed_at, costs, reached, repeats, pure, spent, ready
    cdef public long long[::1] weights
    cdef int[::1] end_of, tests, missing, supporter, marked, is_goal, stack, used
    cdef readonly int[::1] fits, helpful, relaxed
    cdef double[::1] nudge_by, deficit
    cdef Heap queue

    cpdef long long evaluate(self, Timeline line)

    @cython.locals(fact=int, operator=int, node=int, place=int, action=int, test=int, value=double, change=int, index=int)
    cdef void _begin(self, Timeline line)

    cdef void _hold_true(self, int fact, long long cost, long long time)

    @cython.locals(key="long long")
    cdef void _reach(self, int fact, long long cost, long long time, int operator)

    @cython.locals(fact=int, key="long long", pure="long long", place=int, operator=int, missing=int)
    cdef void _explore(self, Timeline line)

    @cython.locals(cost="long long", time="long long", end="long long", action=int, place=int, fact=int, by=double, repeats="long long", more="long long", before="long long")
    cdef void _fire(self, int operator, Timeline line)

    @cython.locals(size=int, place=int, fact=int, total="long long", operator=int, need=int)
    cdef long long _extract(self, Timeline line)

@cython.final
cdef class Nodes:
    cdef readonly int size, room
    cdef int[::1] parents, codes, depths

    @cython.locals(node=int, more=int)
    cdef int add(self, int parent, int code, int depth)

@cython.final
cdef class Seen:
    cdef long long size, room
    cdef long long[::1] keys, least

    @cython.locals(key="long long", place="long long")
    cdef bint better(self, long long digest, long long makespan)

    @cython.locals(old="long long", place="long long", room="long long", keys="long long[::1]", least="long long[::1]")
    cdef void _grow(self)

@cython.final
cdef class TimeSearch:
    cdef Timeline line
    cdef Relaxation guide
    cdef Poll poll
    cdef Nodes nodes
    cdef Heap every, preferred
    cdef Seen seen
    cdef readonly long long expanded, generated, most, best, bound
    cdef public long long tie
    cdef public double weight
    cdef public int greedy, revisit, cut, newest_first
    cdef long long pushed
    cdef long long boost_every, boost_preferred
    cdef int at, first
    cdef int[::1] path

    @cython.locals(queue=Heap, node=int)
    cdef int _next(self)

    @cython.locals(depth=int, each=int, place=int)
    cdef bint _replay(self, int node)

    cdef int path_room(self)

    @cython.locals(cost="long long", key="long long", depth=int, line=Timeline)
    cdef int _expand(self, int node)

    cdef long long _key(self, long long key) noexcept

    @cython.locals(place=int, operator=int, action=int, guide=Relaxation, line=Timeline, shift=int, step=int)
    cdef void _push_helpful(self, int node, int depth, long long key)

    @cython.locals(place=int, operator=int, action=int, guide=Relaxation, line=Timeline)
    cdef void _push_all(self, int node, int depth, long long key)

    @cython.locals(change=int, place=int, fact=int, guide=Relaxation, line=Timeline)
    cdef bint _is_goal(self)
