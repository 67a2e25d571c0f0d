"""The knowledge base: the domain language, its files and its types.

It computes nothing about robots.
"""
