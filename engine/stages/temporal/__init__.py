"""Search in time: durative actions that may have to overlap, timed changes and numbers.

- `reachable` and `grounding` make instances over numbered facts; `windows` says what fits into
  what.
- `timeline` keeps a sequence of starts and ends of actions, with the times of a
  `temporal_network`, and the state after it (`postfix_programs` computes its numbers).
- `timed_relaxation` estimates by relaxed plans in time; `instant_search` searches best-first.
- `portfolio` gives several searches their turns, and makes the makespan of what they find smaller.
- `bounds` proves that no plan is shorter.
"""
