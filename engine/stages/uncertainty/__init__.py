"""Times that nobody decides: is there a policy that keeps all bounds of a temporal network?

- `controllability` finds out, over `bypass_search`. If there is none, it gives a cycle that shows
  why. `dispatchable_form` makes the policy, `least_relaxation` says what would have to change, and
  `window_chances` with which chance windows are kept.
- `cycle_replay` checks such a cycle by itself. `edge_generation` is the slow, plain way.
"""
