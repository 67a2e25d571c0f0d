"""What is computed from the knowledge base: plans, orders, times, motions, diagnoses."""
