"""MACROPs: plans that were generalised by explaining why they work (ITA, figure 4).

They are learned from plans, looked up for new problems, instantiated and checked.
"""
