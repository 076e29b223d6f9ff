"""Positions on the Earth: the ellipsoid, local frames, map projections, height datums."""
