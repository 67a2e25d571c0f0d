"""The exception handler: which test comes next, which cause explains the exception, and which
repair helps.
"""
