"""The formats in which answers are written, and the files of other systems that are read and
written.
"""
