"""The layers that HRSI writes: one class each, which declares the columns once (`typed_rows`).

A new column is one line here and its values where the rows are made: for an adjusted block in `results.tables`, for
other layers in the algorithm that writes them. Field texts, titles of forms and tables of the documentation follow.
Layers of the laboratory are declared with its algorithms.
"""

from .typed_rows import FlagColumn, FloatColumn, IntegerColumn, LayerRows, TextColumn, column

# ---- an adjusted block -----------------------------------------------------------------------------------------------


class ImageRows(LayerRows, layer="images"):
    """Footprints of the images at the mean height of the block, with what was measured on them."""

    id: TextColumn = column("Id of the image")
    path: TextColumn = column()
    samples: IntegerColumn = column()
    lines: IntegerColumn = column()
    observations: IntegerColumn = column("Measurements on the image that were used")
    footprint_height_m: FloatColumn = column("Ellipsoidal height at which the footprint is drawn", "m")


class GroundPointRows(LayerRows, layer="ground_points"):
    """Points on the ground with their standard deviations; heights above the WGS84 ellipsoid."""

    id: TextColumn = column()
    role: TextColumn = column()
    height: FloatColumn = column()
    sigma_east_m: FloatColumn = column()
    sigma_north_m: FloatColumn = column()
    sigma_height_m: FloatColumn = column()
    rays: IntegerColumn = column("Images on which the point was measured")
    survey_lon: FloatColumn = column()
    survey_lat: FloatColumn = column()
    survey_height: FloatColumn = column()
    sigma_xy: FloatColumn = column()
    sigma_h: FloatColumn = column()


class ImagePointRows(LayerRows, layer="image_points"):
    """Measurements in images at the ground position of their point."""

    id: TextColumn = column()
    role: TextColumn = column()
    image: TextColumn = column()
    sample: FloatColumn = column()
    line: FloatColumn = column()
    sigma_px: FloatColumn = column()
    kind: TextColumn = column()
    quality: FloatColumn = column()
    residual_sample_px: FloatColumn = column()
    residual_line_px: FloatColumn = column()
    sigma_sample_px: FloatColumn = column()
    sigma_line_px: FloatColumn = column()
    weight: FloatColumn = column("Weight of the measurement in the adjustment; 0: not used")
    flag: TextColumn = column()


class ChipRows(LayerRows, layer="chips"):
    """Chips of GCPs that were measured, at the surveyed position, with the pixels that surround them."""

    id: TextColumn = column()
    image: TextColumn = column()
    sensor: TextColumn = column("Name of the satellite")
    acquired: TextColumn = column("Date of the image, UTC")
    kind: TextColumn = column()
    sigma_px: FloatColumn = column()
    image_sample: FloatColumn = column("Position of the point in the image", "px")
    image_line: FloatColumn = column("Position of the point in the image", "px")
    sample: FloatColumn = column()
    line: FloatColumn = column()
    gsd_m: FloatColumn = column("Ground sampling distance", "m")
    east_by_sample_m: FloatColumn = column("Metres east of one sample", "m")
    north_by_sample_m: FloatColumn = column("Metres north of one sample", "m")
    east_by_line_m: FloatColumn = column("Metres east of one line", "m")
    north_by_line_m: FloatColumn = column("Metres north of one line", "m")
    lon: FloatColumn = column()
    lat: FloatColumn = column()
    height: FloatColumn = column()
    sigma_xy: FloatColumn = column()
    sigma_h: FloatColumn = column()
    operation: TextColumn = column("Operation that transformed the survey to WGS84 (JSON)")
    pixels: TextColumn = column("PNG of 16 bits in base64; 0: no pixel")


class ResidualRows(LayerRows, layer="residuals"):
    """Residuals, observed - computed: of known points (level ground), of measurements (level image)."""

    id: TextColumn = column()
    role: TextColumn = column()
    image: TextColumn = column("Id of the image; empty at level ground")
    level: TextColumn = column()
    residual_sample_px: FloatColumn = column(level="image")
    residual_line_px: FloatColumn = column(level="image")
    residual_east_m: FloatColumn = column(level="ground")
    residual_north_m: FloatColumn = column(level="ground")
    residual_height_m: FloatColumn = column(level="ground")
    sigma_sample_px: FloatColumn = column(level="image")
    sigma_line_px: FloatColumn = column(level="image")
    sigma_east_m: FloatColumn = column(level="ground")
    sigma_north_m: FloatColumn = column(level="ground")
    sigma_height_m: FloatColumn = column(level="ground")
    flag: TextColumn = column()


class LaserPointRows(LayerRows, layer="laser_points"):
    """Points of a laser altimeter, whether they constrain the block, and why not."""

    id: TextColumn = column()
    track: TextColumn = column("Track of the laser altimeter")
    used: FlagColumn = column()
    reason: TextColumn = column("Why it is not used")
    residual_height_m: FloatColumn = column()
    ties: IntegerColumn = column("Tie points that it constrains")
    sigma_m: FloatColumn = column("Standard deviation of the height", "m")
    stated_sigma_m: FloatColumn = column("Standard deviation of the height as the file states it", "m")
    misfit_m: FloatColumn = column("Misfit of the segment as the file states it", "m")
    photons: FloatColumn = column("Photons of the segment")
    slope: FloatColumn = column("Slope of the ground along the track")
    canopy_m: FloatColumn = column("Height of the canopy", "m")


class SurfaceResidualRows(LayerRows, layer="surface_residuals"):
    """Tie points that a surface was matched with, and their heights above it."""

    id: TextColumn = column()
    residual_before_m: FloatColumn = column("Height above the surface by the RPCs as given", "m")
    residual_height_m: FloatColumn = column("Height above the surface after the adjustment", "m")
    holds: FlagColumn = column("Whether the surface determines the position in plan of the part of the block")


# ---- what is measured in images --------------------------------------------------------------------------------------


class TiePointRows(LayerRows, layer="tie_points"):
    """Tie points at their approximate ground positions."""

    id: TextColumn = column()
    views: IntegerColumn = column()
    height: FloatColumn = column()
    sigma: FloatColumn = column()
    quality: FloatColumn = column()
    kind: TextColumn = column()


class MeasurementRows(LayerRows, layer="image_points"):
    """Measurements in images at the approximate ground position of their point."""

    id: TextColumn = column()
    image: TextColumn = column()
    sample: FloatColumn = column()
    line: FloatColumn = column()
    sigma: FloatColumn = column()
    kind: TextColumn = column()
    quality: FloatColumn = column()


class TargetRows(MeasurementRows, layer="targets"):
    """Measured targets."""

    rmse_px: FloatColumn = column("Root mean square of the edge points about the fitted curve", "px")
    edge_points: IntegerColumn = column("Edge points in the fit")


class ReferenceGcpRows(MeasurementRows, layer="gcps"):
    """Ground control points found in a reference orthoimage."""

    role: TextColumn = column()
    sigma_xy: FloatColumn = column()
    sigma_h: FloatColumn = column()
    survey_lon: FloatColumn = column()
    survey_lat: FloatColumn = column()
    survey_height: FloatColumn = column()
    residual_sample_px: FloatColumn = column("Observed - expected by the bias of the image, along the rows", "px")
    residual_line_px: FloatColumn = column("Observed - expected by the bias of the image, along the columns", "px")


class RejectedMatchRows(ReferenceGcpRows, layer="rejected"):
    """Matches with the reference that do not follow the bias of their image."""


class MisregistrationRows(LayerRows, layer="misregistration"):
    """Shifts between orthoimages, second - first, measured in windows."""

    first: TextColumn = column()
    second: TextColumn = column()
    state: TextColumn = column("before: orthoimages of the RPCs as delivered; after: of the refined ones")
    outcome: TextColumn = column("measured, or why there is no shift")
    dx_px: FloatColumn = column("Shift along the rows", "px")
    dy_px: FloatColumn = column("Shift along the columns, down", "px")
    shift_px: FloatColumn = column("Length of the shift", "px")
    east_m: FloatColumn = column("Shift to the east", "m")
    north_m: FloatColumn = column("Shift to the north", "m")
    correlation: FloatColumn = column()
    sigma_px: FloatColumn = column("Standard deviation of the shift along each axis", "px")


class SeamlineRows(LayerRows, layer="seamlines"):
    """Areas of a mosaic, with the image from which their pixels are."""

    id: TextColumn = column("Id of the image")
    path: TextColumn = column("Orthoimage")
    incidence_deg: FloatColumn = column("Incidence angle at the middle of the image", "degrees")


# ---- geometry of RPCs -----------------------------------------------------------------------------------------------


class ProjectedPointRows(LayerRows, layer="image_points"):
    """Ground points as the images' RPCs project them."""

    id: TextColumn = column()
    image: TextColumn = column()
    sample: FloatColumn = column()
    line: FloatColumn = column()
    inside: FlagColumn = column("Whether the position lies on the image")
    lon: FloatColumn = column()
    lat: FloatColumn = column()
    height: FloatColumn = column()


class LocalizedPointRows(LayerRows, layer="ground_points"):
    """Image points, localized on the ground by the RPCs of their images."""

    id: TextColumn = column()
    image: TextColumn = column()
    sample: FloatColumn = column()
    line: FloatColumn = column()
    lon: FloatColumn = column()
    lat: FloatColumn = column()
    height: FloatColumn = column()
    status: TextColumn = column("found, or why there is no position")


class ViewRows(LayerRows, layer="images"):
    """Footprints of the images, and their viewing geometry."""

    id: TextColumn = column("Id of the image")
    path: TextColumn = column()
    rpc_source: TextColumn = column("Source of the RPC")
    samples: FloatColumn = column()
    lines: FloatColumn = column()
    lon: FloatColumn = column("Longitude of the image's middle", "degrees")
    lat: FloatColumn = column("Latitude of the image's middle", "degrees")
    height_m: FloatColumn = column("Ellipsoidal height of the image's middle", "m")
    gsd_sample_m: FloatColumn = column("Ground sampling distance along the rows", "m")
    gsd_line_m: FloatColumn = column("Ground sampling distance along the columns", "m")
    incidence_deg: FloatColumn = column("Incidence angle on the ground", "degrees")
    azimuth_deg: FloatColumn = column("Azimuth from the ground to the sensor", "degrees")
    sun_azimuth_deg: FloatColumn = column("Azimuth of the sun", "degrees")
    sun_elevation_deg: FloatColumn = column("Elevation of the sun", "degrees")
    sun_source: TextColumn = column("File with the position of the sun")
    rpc_height_min_m: FloatColumn = column("Lowest height for which the RPC was made", "m")
    rpc_height_max_m: FloatColumn = column("Highest height for which the RPC was made", "m")
    err_bias_m: FloatColumn = column("Bias error that the RPC states", "m")
    err_rand_m: FloatColumn = column("Random error that the RPC states", "m")


class PairRows(LayerRows, layer="pairs"):
    """Pairs of overlapping images."""

    first: TextColumn = column()
    second: TextColumn = column()
    overlap_first: FloatColumn = column("Share of the first image that the second one covers")
    overlap_second: FloatColumn = column("Share of the second image that the first one covers")
    convergence_deg: FloatColumn = column("Convergence angle of the two rays", "degrees")
    base_to_height: FloatColumn = column("Base over height")


class EvaluatedResidualRows(LayerRows, layer="residuals"):
    """Residuals of a set of RPCs: of tracks on the images, of known points on the images and on the ground."""

    id: TextColumn = column()
    role: TextColumn = column()
    image: TextColumn = column("Id of the image; empty at level ground")
    level: TextColumn = column()
    residual: TextColumn = column("predicted: from the other images; fit: by all of them; known: at a known position")
    residual_sample_px: FloatColumn = column(level="image")
    residual_line_px: FloatColumn = column(level="image")
    residual_east_m: FloatColumn = column(level="ground")
    residual_north_m: FloatColumn = column(level="ground")
    residual_height_m: FloatColumn = column(level="ground")
    flag: TextColumn = column()


class EvaluatedPairRows(LayerRows, layer="pairs"):
    """Distances of the tracks of two images from their epipolar lines, for each set of RPCs."""

    set: TextColumn = column("Name of the set of RPCs")
    first: TextColumn = column()
    second: TextColumn = column()
    points: IntegerColumn = column("Tracks on both images")
    bias_px: FloatColumn = column("Median distance across the epipolar lines", "px")
    nmad_px: FloatColumn = column("Robust standard deviation about the median", "px")
    rmse_px: FloatColumn = column("Root mean square of the distances", "px")
