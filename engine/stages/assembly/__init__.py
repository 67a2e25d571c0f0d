"""Where parts are when spatial relations hold between their features (Popplestone, Ambler & Bellos
1980; Mazer 1983).

Relations become equations; the equations are solved for the poses of all parts at once.
"""
