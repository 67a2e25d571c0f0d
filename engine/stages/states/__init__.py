"""Task-space modelling: generates the contact states of a cell, and the net of places and
transitions between them.
"""
