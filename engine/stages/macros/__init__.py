"""MACROPs: plans generalised by explaining why they work, looked up, instantiated and checked (ITA, figure 4)."""
