"""Times that nobody decides: is there a policy that keeps all bounds of a temporal network?

- `controllability` finds out, over `bypass_search`; if there is none, it gives a cycle that shows why.
- `cycle_replay` checks such a cycle by itself. `edge_generation` is the slow, plain way.
"""
