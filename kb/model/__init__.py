"""The values that files hold, written by people or by the program itself: domains, problems,
plans.
"""
