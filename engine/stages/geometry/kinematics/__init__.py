"""Kinematics of arms: where a configuration puts the flange, and which configurations reach a
pose.
"""
