# cython: language_level=3, annotation_typing=False, boundscheck=False, wraparound=False
# cython: initializedcheck=False, cdivision=True
"""Numbers ordered by key in a binary heap: the open list of the searches in time.

The module is plain Python. Cython compiles it with the types in `key_heap.pxd`; without a
compiler it runs slowly.
"""

from array import array

from cellwright.engine.kernels.packed_rows import zero_ints, zero_longs


class KeyHeap:
    """Numbers ordered by key, in a binary heap.

    The first is heap[0] and its key keys[0]; read them before `pop`.
    """

    def __init__(self, room: int) -> None:
        self.size, self.room = 0, max(room, 16)
        self.heap, self.keys = zero_ints(self.room), zero_longs(self.room)

    def _grow(self) -> None:
        heap, keys = zero_ints(self.room), zero_longs(self.room)
        self.heap_kept, self.keys_kept = array("i", self.heap) + heap, array("q", self.keys) + keys
        self.heap, self.keys = self.heap_kept, self.keys_kept
        self.room *= 2

    def push(self, item: int, key: int) -> None:
        """Puts a number in."""
        if self.size == self.room:
            self._grow()
        place = self.size
        self.size += 1
        while place > 0:
            parent = (place - 1) // 2
            if self.keys[parent] <= key:
                break
            self.heap[place], self.keys[place] = self.heap[parent], self.keys[parent]
            place = parent
        self.heap[place], self.keys[place] = item, key

    def pop(self) -> None:
        """Takes the first number out."""
        self.size -= 1
        item, key = self.heap[self.size], self.keys[self.size]
        place = 0
        while True:
            child = 2 * place + 1
            if child >= self.size:
                break
            if child + 1 < self.size and self.keys[child + 1] < self.keys[child]:
                child += 1
            if self.keys[child] >= key:
                break
            self.heap[place], self.keys[place] = self.heap[child], self.keys[child]
            place = child
        self.heap[place], self.keys[place] = item, key
