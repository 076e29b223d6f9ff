"""What layers and their fields hold, for who opens a GeoPackage without the documentation.

A field means the same in every layer, so its text stands here once; a layer is told by its name.
"""

from __future__ import annotations

#: By the name of the layer.
LAYER_TEXTS = {
    "images": "Footprints of the images at the mean height of the block, with what was measured on them",
    "ground_points": "Points on the ground with their standard deviations; heights above the WGS84 ellipsoid",
    "image_points": "Measurements in images at the ground position of their point",
    "residuals_wgs84": "Residuals, observed - computed: of known points (level ground), of measurements (level image)",
    "residuals_utm": "Residuals, observed - computed: of known points (level ground), of measurements (level image)",
    "laser_points": "Points of a laser altimeter, whether they hold the block, and why not",
    "tie_points": "Tie points at their approximate ground positions",
    "gcps": "Ground control points found in a reference orthoimage",
    "rejected": "Matches with the reference that do not follow the bias of their image",
    "interest_points": "Interest points at the ground positions of their images' RPCs",
    "targets": "Measured targets",
}
#: By the name of the field.
FIELD_TEXTS = {
    "id": "Id of the point or image",
    "path": "File of the image",
    "samples": "Columns of the image, px",
    "lines": "Rows of the image, px",
    "observations": "Measurements on the image that took part",
    "footprint_height_m": "Ellipsoidal height at which the footprint is drawn, m",
    "role": "gcp: control; check: known, and took no part; tie: unknown",
    "height": "Height above the WGS84 ellipsoid, m",
    "rays": "Images on which the point was measured",
    "views": "Images on which the point was found",
    "survey_lon": "Longitude as surveyed, degrees",
    "survey_lat": "Latitude as surveyed, degrees",
    "survey_height": "Ellipsoidal height as surveyed, m",
    "sigma_xy": "Standard deviation of each horizontal coordinate as surveyed, m",
    "sigma_h": "Standard deviation of the height as surveyed, m",
    "sigma_east_m": "Standard deviation of the coordinate or residual to the east, m",
    "sigma_north_m": "Standard deviation of the coordinate or residual to the north, m",
    "sigma_height_m": "Standard deviation of the height or its residual, m",
    "image": "Id of the image",
    "sample": "Column, px; 0 is the CENTRE of the first pixel",
    "line": "Row, px; 0 is the CENTRE of the first pixel",
    "sigma_px": "Standard deviation of the measurement along each axis, px",
    "sigma": "Standard deviation of the measurement along each axis, px",
    "kind": "What was measured, or how",
    "quality": "Quality of the measurement, 0 to 1",
    "level": "ground: residual of a known point on the ground; image: of a measurement in an image",
    "residual_sample_px": "Observed - computed along the rows, px",
    "residual_line_px": "Observed - computed along the columns, px",
    "residual_east_m": "Surveyed - computed to the east, m",
    "residual_north_m": "Surveyed - computed to the north, m",
    "residual_height_m": "Surveyed - computed height, m",
    "sigma_sample_px": "Standard deviation of residual_sample_px: divided by it, it is what the flag is made from, px",
    "sigma_line_px": "Standard deviation of residual_line_px: divided by it, it is what the flag is made from, px",
    "weight": "Weight of the measurement in the adjustment; 0 took no part",
    "flag": "ok, or what is to be said of the residual",
    "track": "Track of the laser altimeter",
    "used": "Whether it takes part",
    "reason": "Why it does not take part",
    "ties": "Tie points that it holds",
    "sigma_m": "Standard deviation of the height, m",
    "stated_sigma_m": "Standard deviation of the height as the file states it, m",
    "misfit_m": "Misfit of the segment as the file states it, m",
    "photons": "Photons of the segment",
    "slope": "Slope of the ground along the track",
    "canopy_m": "Height of the canopy, m",
}
