"""External observations of point positions: heights of a DEM or laser points, plan of a reference orthoimage."""
