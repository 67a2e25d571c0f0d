"""Golden plans: the problems of a domain are planned again, and the answers are compared with
those accepted before.
"""
