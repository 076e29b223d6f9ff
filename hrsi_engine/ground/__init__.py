"""Positions on the Earth: the ellipsoid, local frames, projections, and what heights refer to."""
