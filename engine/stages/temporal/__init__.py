"""Search in time: durative actions that may have to overlap, timed changes and numbers.

- `reachable` and `grounding` make instances over numbered facts; `windows` says what fits into
  what.
- `kernels` orders instants in sequences with the times of a simple temporal network, and estimates
  by relaxed plans in time.
- `portfolio` gives several searches their turns, and makes the makespan of what they find smaller.
- `bounds` proves that no plan is shorter.
"""
