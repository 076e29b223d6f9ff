"""The layers that HRSI writes: a class each, which declares the columns once (`typed_rows`).

A new column is a line here and its values where the rows are made: those of an adjusted block in `results.tables`, the
others in the algorithm that writes the layer. Field texts, titles in forms and the tables of the documentation follow.
"""

from __future__ import annotations

from .typed_rows import Flags, Floats, Integers, Rows, Texts, column

# ---- an adjusted block -----------------------------------------------------------------------------------------------


class ImageRows(Rows, layer="images"):
    """Footprints of the images at the mean height of the block, with what was measured on them."""

    id: Texts = column("Id of the image")
    path: Texts = column()
    samples: Integers = column()
    lines: Integers = column()
    observations: Integers = column("Measurements on the image that took part")
    footprint_height_m: Floats = column("Ellipsoidal height at which the footprint is drawn", "m")


class GroundPointRows(Rows, layer="ground_points"):
    """Points on the ground with their standard deviations; heights above the WGS84 ellipsoid."""

    id: Texts = column()
    role: Texts = column()
    height: Floats = column()
    sigma_east_m: Floats = column()
    sigma_north_m: Floats = column()
    sigma_height_m: Floats = column()
    rays: Integers = column("Images on which the point was measured")
    survey_lon: Floats = column()
    survey_lat: Floats = column()
    survey_height: Floats = column()
    sigma_xy: Floats = column()
    sigma_h: Floats = column()


class ImagePointRows(Rows, layer="image_points"):
    """Measurements in images at the ground position of their point."""

    id: Texts = column()
    role: Texts = column()
    image: Texts = column()
    sample: Floats = column()
    line: Floats = column()
    sigma_px: Floats = column()
    kind: Texts = column()
    quality: Floats = column()
    residual_sample_px: Floats = column()
    residual_line_px: Floats = column()
    sigma_sample_px: Floats = column()
    sigma_line_px: Floats = column()
    weight: Floats = column("Weight of the measurement in the adjustment; 0 took no part")
    flag: Texts = column()


class ResidualRows(Rows, layer="residuals"):
    """Residuals, observed - computed: of known points (level ground), of measurements (level image)."""

    id: Texts = column()
    role: Texts = column()
    image: Texts = column("Id of the image; empty at level ground")
    level: Texts = column()
    residual_sample_px: Floats = column(level="image")
    residual_line_px: Floats = column(level="image")
    residual_east_m: Floats = column(level="ground")
    residual_north_m: Floats = column(level="ground")
    residual_height_m: Floats = column(level="ground")
    sigma_sample_px: Floats = column(level="image")
    sigma_line_px: Floats = column(level="image")
    sigma_east_m: Floats = column(level="ground")
    sigma_north_m: Floats = column(level="ground")
    sigma_height_m: Floats = column(level="ground")
    flag: Texts = column()


class LaserPointRows(Rows, layer="laser_points"):
    """Points of a laser altimeter, whether they hold the block, and why not."""

    id: Texts = column()
    track: Texts = column("Track of the laser altimeter")
    used: Flags = column()
    reason: Texts = column("Why it does not take part")
    residual_height_m: Floats = column()
    ties: Integers = column("Tie points that it holds")
    sigma_m: Floats = column("Standard deviation of the height", "m")
    stated_sigma_m: Floats = column("Standard deviation of the height as the file states it", "m")
    misfit_m: Floats = column("Misfit of the segment as the file states it", "m")
    photons: Floats = column("Photons of the segment")
    slope: Floats = column("Slope of the ground along the track")
    canopy_m: Floats = column("Height of the canopy", "m")


# ---- what is measured in images --------------------------------------------------------------------------------------


class TiePointRows(Rows, layer="tie_points"):
    """Tie points at their approximate ground positions."""

    id: Texts = column()
    views: Integers = column()
    height: Floats = column()
    sigma: Floats = column()
    quality: Floats = column()
    kind: Texts = column()


class MeasurementRows(Rows, layer="image_points"):
    """Measurements in images at the approximate ground position of their point."""

    id: Texts = column()
    image: Texts = column()
    sample: Floats = column()
    line: Floats = column()
    sigma: Floats = column()
    kind: Texts = column()
    quality: Floats = column()


class MatchedPointRows(MeasurementRows, layer="matched_points"):
    """The correspondences of two images as measurements, ready as image points."""


class InterestPointRows(MeasurementRows, layer="interest_points"):
    """Interest points at the ground positions of their images' RPCs."""

    strength: Floats = column("Strength by the detector, larger is better")
    length_px: Floats = column("Longer diameter or side of the shape; empty for corners", "px")
    width_px: Floats = column("Shorter diameter or side of the shape; empty for corners", "px")
    azimuth_deg: Floats = column("Direction of the longer one in the image", "degrees")
    contrast: Floats = column("Grey values inside - outside; empty for corners")
    rmse_px: Floats = column("Root mean square of the outline about the shape; empty for corners", "px")
    shadow: Texts = column("yes or no: a dark centre on the shadow side; unknown without the sun's direction")


class TargetRows(MeasurementRows, layer="targets"):
    """Measured targets."""

    rmse_px: Floats = column("Root mean square of the edge points about the fitted curve", "px")
    edge_points: Integers = column("Edge points in the fit")


class ReferenceGcpRows(MeasurementRows, layer="gcps"):
    """Ground control points found in a reference orthoimage."""

    role: Texts = column()
    sigma_xy: Floats = column()
    sigma_h: Floats = column()
    survey_lon: Floats = column()
    survey_lat: Floats = column()
    survey_height: Floats = column()
    residual_sample_px: Floats = column("Observed - expected by the bias of the image, along the rows", "px")
    residual_line_px: Floats = column("Observed - expected by the bias of the image, along the columns", "px")


class RejectedMatchRows(ReferenceGcpRows, layer="rejected"):
    """Matches with the reference that do not follow the bias of their image."""


class CorrespondenceRows(Rows, layer="correspondences"):
    """Correspondences of two images, each with its place in the control network."""

    id: Texts = column()
    first_sample: Floats = column()
    first_line: Floats = column()
    second_sample: Floats = column()
    second_line: Floats = column()
    kind: Texts = column()
    sigma: Floats = column()
    quality: Floats = column("Correlation of the grey values after matching")
    residual_px: Floats = column("Difference from what the neighbours predict", "px")
    epipolar_px: Floats = column("Distance from the epipolar line", "px")
    generation: Integers = column("0: the root of the network, 1: its leaves, then one more than the father's")
    father: Texts = column("Id of the correspondence from which it was found; empty for the root")


class RegisteredPointRows(Rows, layer="residuals"):
    """Tie points of a registration with what the registration leaves of them."""

    id: Texts = column()
    kind: Texts = column()
    used: Flags = column()
    first_sample: Floats = column()
    first_line: Floats = column()
    second_sample: Floats = column()
    second_line: Floats = column()
    residual_x: Floats = column("Residual along x, in the unit of the report")
    residual_y: Floats = column("Residual along y, in the unit of the report")


class MisregistrationRows(Rows, layer="misregistration"):
    """Shifts between orthoimages, second - first, measured in windows."""

    first: Texts = column()
    second: Texts = column()
    state: Texts = column("before: orthoimages of the RPCs as delivered; after: of the refined ones")
    outcome: Texts = column("measured, or why there is no shift")
    dx_px: Floats = column("Shift along the rows", "px")
    dy_px: Floats = column("Shift along the columns, down", "px")
    shift_px: Floats = column("Length of the shift", "px")
    east_m: Floats = column("Shift to the east", "m")
    north_m: Floats = column("Shift to the north", "m")
    correlation: Floats = column()
    sigma_px: Floats = column("Standard deviation of the shift along each axis", "px")


# ---- what RPCs say ---------------------------------------------------------------------------------------------------


class ProjectedPointRows(Rows, layer="image_points"):
    """Ground points as the images' RPCs project them."""

    id: Texts = column()
    image: Texts = column()
    sample: Floats = column()
    line: Floats = column()
    inside: Flags = column("Whether the position lies on the image")
    lon: Floats = column()
    lat: Floats = column()
    height: Floats = column()


class LocalizedPointRows(Rows, layer="ground_points"):
    """Image points as the images' RPCs see them on the ground."""

    id: Texts = column()
    image: Texts = column()
    sample: Floats = column()
    line: Floats = column()
    lon: Floats = column()
    lat: Floats = column()
    height: Floats = column()
    status: Texts = column("found, or why there is no position")


class ViewRows(Rows, layer="images"):
    """Footprints of the images, and how they see the ground."""

    id: Texts = column("Id of the image")
    path: Texts = column()
    rpc_source: Texts = column("Where the RPC stands")
    samples: Floats = column()
    lines: Floats = column()
    lon: Floats = column("Longitude of the image's middle", "degrees")
    lat: Floats = column("Latitude of the image's middle", "degrees")
    height_m: Floats = column("Ellipsoidal height of the image's middle", "m")
    gsd_sample_m: Floats = column("Ground sampling distance along the rows", "m")
    gsd_line_m: Floats = column("Ground sampling distance along the columns", "m")
    incidence_deg: Floats = column("Incidence angle on the ground", "degrees")
    azimuth_deg: Floats = column("Azimuth from the ground to the sensor", "degrees")
    sun_azimuth_deg: Floats = column("Azimuth of the sun", "degrees")
    sun_elevation_deg: Floats = column("Elevation of the sun", "degrees")
    sun_source: Texts = column("File that tells where the sun stood")
    rpc_height_min_m: Floats = column("Lowest height for which the RPC was made", "m")
    rpc_height_max_m: Floats = column("Highest height for which the RPC was made", "m")
    err_bias_m: Floats = column("Bias error that the RPC states", "m")
    err_rand_m: Floats = column("Random error that the RPC states", "m")


class PairRows(Rows, layer="pairs"):
    """Pairs of overlapping images."""

    first: Texts = column()
    second: Texts = column()
    overlap_first: Floats = column("Share of the first image that the second one sees too")
    overlap_second: Floats = column("Share of the second image that the first one sees too")
    convergence_deg: Floats = column("Convergence angle of the two rays", "degrees")
    base_to_height: Floats = column("Base over height")


class EvaluatedResidualRows(Rows, layer="residuals"):
    """Residuals of a set of RPCs: of tracks on the images, of known points on the images and on the ground."""

    id: Texts = column()
    role: Texts = column()
    image: Texts = column("Id of the image; empty at level ground")
    level: Texts = column()
    residual: Texts = column("predicted: from the other images; fit: by all of them; known: at a known position")
    residual_sample_px: Floats = column(level="image")
    residual_line_px: Floats = column(level="image")
    residual_east_m: Floats = column(level="ground")
    residual_north_m: Floats = column(level="ground")
    residual_height_m: Floats = column(level="ground")
    flag: Texts = column()


class EvaluatedPairRows(Rows, layer="pairs"):
    """How far the tracks of two images lie across their epipolar lines, for each set of RPCs."""

    set: Texts = column("Name of the set of RPCs")
    first: Texts = column()
    second: Texts = column()
    points: Integers = column("Tracks on both images")
    bias_px: Floats = column("Median distance across the epipolar lines", "px")
    nmad_px: Floats = column("Robust standard deviation about the median", "px")
    rmse_px: Floats = column("Root mean square of the distances", "px")
