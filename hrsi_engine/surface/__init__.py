"""The terrain surface: heights of a DEM, intersection of rays with it, and matching of points with it."""
