"""Agreement of external sources (laser points, a DEM, a reference orthoimage) with an adjusted block."""

from dataclasses import dataclass

import numpy as np

from ..block.laser import LaserPoints
from ..surface.dem import HeightSurface
from ..surface.matching import SurfaceMatch


@dataclass(frozen=True)
class SourceGroup:
    """Observations with a common error (a laser track or a part of a DEM), compared with all groups of all sources.

    offset_m : their mean minus that of all groups, with the standard deviation sigma_m
    wrong : True if it contradicts the others; left_out : True if it was rejected, because it is identified as wrong
    """

    name: str
    observations: int
    offset_m: float
    sigma_m: float
    wrong: bool
    left_out: bool


@dataclass(frozen=True)
class HeightAgreement:
    """A source of heights that constrain tie points: numbers of observations and of rejected ones.

    determines : number of unknowns that it determines: used observations minus their partial redundancy
    rmse_m : of point - source, of the used ones; left_out_median_m : median of point - source of the rejected ones
    sigma_m : median standard deviation as estimated, sigma_factor times the given one
    share : weight in the height of the block, of all sources; alone_m : change of its height if this source alone
    determined it
    gcps : number of GCPs whose surveyed heights contradict the source, and number of compared GCPs
    """

    source: str
    observations: int
    left_out: int
    determines: float
    rmse_m: float
    left_out_median_m: float
    sigma_m: float
    sigma_factor: float
    share: float
    alone_m: float
    groups: tuple[SourceGroup, ...] = ()
    gcps: tuple[int, int] = (0, 0)

    @property
    def contradicts(self) -> bool:
        """True if all of its groups contradict the other constraints of the block, probably with one cause."""
        return bool(self.groups) and all(group.wrong for group in self.groups)


@dataclass(frozen=True)
class PlanGroup:
    """Places in one part of an orthoimage, against the other parts; as `SourceGroup`, in east and north."""

    name: str
    observations: int
    east_m: float
    north_m: float
    sigma_m: float
    wrong: bool
    left_out: bool


@dataclass(frozen=True)
class PlanAgreement:
    """An orthoimage that constrains the block in plan; as `HeightAgreement`, with two observations per place.

    rmse_m : of a coordinate, point - source, of the places that fit
    sigma_m : of a coordinate of a place: the common error, as given, and sigma_factor times the independent one
    share : weight in the position of the block against that of the RPCs
    alone_m : change of position, east and north, if it alone determined the block
    """

    source: str
    observations: int
    left_out: int
    determines: float
    rmse_m: float
    sigma_m: float
    sigma_factor: float
    share: float
    alone_m: tuple[float, float]
    groups: tuple[PlanGroup, ...] = ()


@dataclass(frozen=True, eq=False)
class SurfaceOutcome:
    """Result of matching a part of a block without GCPs with the relief of a surface.

    images : ids of the part's images
    match : match at the positions by the original RPCs; left_m : (3,) displacement after the adjustment
    covariance_m2 : (3, 3) of the position by the surface, including the error of the surface
    open : reason why it does not determine the part in plan, or empty
    pointing_m : standard deviation of each coordinate in plan by the RPCs
    beyond_pointing : length of the displacement in plan over its standard deviation, with that of the RPCs' position
    surface : the surface; points : (k,) its tie points in the block; before : (k, 3) these by the original RPCs
    """

    images: tuple[str, ...]
    match: SurfaceMatch
    left_m: np.ndarray
    covariance_m2: np.ndarray
    open: str
    pointing_m: float
    beyond_pointing: float
    surface: HeightSurface
    points: np.ndarray
    before: np.ndarray


@dataclass(frozen=True, eq=False)
class LaserOutcome:
    """Use of each laser point ``(n,)``, in the order of the points.

    points : the laser points; reason : why one is not used, or empty
    ties : number of tie points that it constrains; residual_m : its height minus theirs, NaN without any
    sigma_m : standard deviation of its height at the tie points, including that of the ground between them
    """

    points: LaserPoints
    reason: np.ndarray
    ties: np.ndarray
    residual_m: np.ndarray
    sigma_m: np.ndarray
