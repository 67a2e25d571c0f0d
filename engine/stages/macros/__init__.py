"""MACROPs, plans generalised by explaining why they work: learning them and looking them up.

They are learned from plans, looked up for new problems, instantiated and checked.
"""
