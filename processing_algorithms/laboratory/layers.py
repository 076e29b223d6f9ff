"""The layers that the laboratory's algorithms write, as `hrsi_engine.io.geopackage.declared_layers` has the others."""

from ...hrsi_engine.io.geopackage.declared_layers import MeasurementRows
from ...hrsi_engine.io.geopackage.typed_rows import (
    FlagColumn,
    FloatColumn,
    IntegerColumn,
    LayerRows,
    TextColumn,
    column,
)


class MatchedPointRows(MeasurementRows, layer="matched_points"):
    """The correspondences of two images as measurements, ready as image points."""


class InterestPointRows(MeasurementRows, layer="interest_points"):
    """Interest points at the ground positions of their images' RPCs."""

    strength: FloatColumn = column("Strength by the detector, larger is better")
    length_px: FloatColumn = column("Longer diameter or side of the shape; empty for corners", "px")
    width_px: FloatColumn = column("Shorter diameter or side of the shape; empty for corners", "px")
    azimuth_deg: FloatColumn = column("Direction of the longer one in the image", "degrees")
    contrast: FloatColumn = column("Grey values inside - outside; empty for corners")
    rmse_px: FloatColumn = column("Root mean square of the outline about the shape; empty for corners", "px")
    shadow: TextColumn = column("yes or no: a dark centre on the shadow side; unknown without the sun's direction")


class CorrespondenceRows(LayerRows, layer="correspondences"):
    """Correspondences of two images, each with its place in the control network."""

    id: TextColumn = column()
    first_sample: FloatColumn = column()
    first_line: FloatColumn = column()
    second_sample: FloatColumn = column()
    second_line: FloatColumn = column()
    kind: TextColumn = column()
    sigma: FloatColumn = column()
    quality: FloatColumn = column("Correlation of the grey values after matching")
    residual_px: FloatColumn = column("Difference from what the neighbours predict", "px")
    epipolar_px: FloatColumn = column("Distance from the epipolar line", "px")
    generation: IntegerColumn = column("0: the root of the network, 1: its leaves, then one more than the father's")
    father: TextColumn = column("Id of the correspondence from which it was found; empty for the root")


class RegisteredPointRows(LayerRows, layer="residuals"):
    """Tie points of a registration with what the registration leaves of them."""

    id: TextColumn = column()
    kind: TextColumn = column()
    used: FlagColumn = column()
    first_sample: FloatColumn = column()
    first_line: FloatColumn = column()
    second_sample: FloatColumn = column()
    second_line: FloatColumn = column()
    residual_x: FloatColumn = column("Residual along x, in the unit of the report")
    residual_y: FloatColumn = column("Residual along y, in the unit of the report")
