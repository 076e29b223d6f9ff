"""GeoPackage layers: tables, spatial index, styles and field descriptions."""
