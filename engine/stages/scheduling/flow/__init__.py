"""Schedules of many objects that flow through a cell, with the choice of machines, arms and
places.
"""
