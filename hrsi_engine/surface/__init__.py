"""The surface that rays meet: heights of a DEM, and where a ray intersects it."""
