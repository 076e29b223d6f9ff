"""What the tables of a point session show: one row a ground point, and one row an image for each point."""

from dataclasses import dataclass
from math import nan

from ...hrsi_engine.adjustment.options import AdjustOptions
from ...hrsi_engine.foundation.thresholds import threshold, thresholds
from ..interface.declare import params_of

#: A point that is ``off`` keeps its measurements and takes no part.
ROLES = ("gcp", "check", "off")
TIE = "tie"  #: of a point without a survey, whose position is where its rays meet; it is made so, and stays so
TRANSFERRED = "transfer"  #: kind of a measurement that was found by matching
CLICK_KINDS = ("center", "corner", "point")  #: how a click is measured; ``point`` takes it as it is
#: The adjustment's option that the panel offers; all others are at their defaults.
MODEL = next(param for param in params_of(AdjustOptions) if param.argument == "model")


@thresholds
class PANEL:
    """What the panel keeps and shows."""

    longest_history: int = threshold(1000, "edits", "that can be undone")
    half_stretch_px: int = threshold(128, "px", "half the side of the window whose greys are shown from black to white")


@dataclass(frozen=True)
class SurveyPoint:
    """A ground point with a surveyed position, or a tie point where its rays meet; NaN sigmas take the default.

    ``operation`` is what brought it to WGS84, as a report's ``crs_operations`` have it (JSON).
    """

    id: str
    lon: float
    lat: float
    height: float
    role: str = "gcp"
    sigma_xy: float = nan
    sigma_h: float = nan
    operation: str = ""


@dataclass(frozen=True)
class ImageMeasurement:
    """Where a point was measured on an image; a NaN sigma takes the default."""

    sample: float
    line: float
    sigma: float = nan
    kind: str = ""
    quality: float = nan


@dataclass(frozen=True)
class PointRow:
    """A ground point, its residuals (survey - computed, metres east, north, up; NaN without), why it is suspicious."""

    point: SurveyPoint
    images: int
    residual_m: tuple[float, float, float]
    suspicion: str


@dataclass(frozen=True)
class MeasurementRow:
    """A point on one image: predicted and measured position, residual (px), and why it is suspicious, if it is."""

    image: str
    predicted: tuple[float, float]
    is_inside: bool
    measured: ImageMeasurement | None
    residual_px: tuple[float, float]
    suspicion: str
