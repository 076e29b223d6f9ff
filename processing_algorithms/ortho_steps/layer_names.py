"""The layers that `ortho-check` writes: named where its declaration can read them without loading GDAL."""

LAYERS_FILE, LAYERS = "misregistration.gpkg", ("misregistration_utm", "misregistration_wgs84")
