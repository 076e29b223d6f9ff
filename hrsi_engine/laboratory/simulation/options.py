"""What a simulated block should be like: the scene, how many points, and their errors."""

from __future__ import annotations

from typing import NamedTuple

from ...foundation.errors import InputError
from ...foundation.options import option, options

#: Sensors (`sensors.SENSORS`).
SENSOR_NAMES = ("ikonos", "quickbird", "worldview-2", "pleiades", "spot5", "wide-field")
#: Azimuth of the flight (degrees), and the share by which neighbouring places overlap.
HEADING_DEG, STRIP_OVERLAP = 190.0, 0.2


class Landform(NamedTuple):
    """What the ground is like.

    Parameters
    ----------
    relief_m : float
        Range of its heights.
    town : float or None
        Share of the blocks of land that are built up, with buildings above the ground; None: the
        landscape's own share, its roofs flat on the ground.
    """

    relief_m: float
    town: float | None = None


#: What `simulate` can be asked for; over 6 km their slopes are 40, 12, 4, 1.3 and 0.1 % (rms over 30 m).
LANDFORMS = {
    "mountains": Landform(1000.0),
    "hills": Landform(300.0),
    "farmland": Landform(100.0),
    "city": Landform(30.0, 0.7),
    "flat": Landform(2.0),
}


@options
class SceneSpec:
    """What a scene should be like; the same spec and views always give the same scene.

    Parameters
    ----------
    half_extent_m, post_m, scale : float, optional
        Half the side, spacing of the terrain, scale of the landscape; by default they follow from the views.
    change : float, optional
        0 … 1, how much of the ground looks different at a `SceneView.date` other than 0.
    """

    lon_deg: float = option(5.45, "Longitude of the scene's centre", name="lon", unit="deg", metavar="DEG")
    lat_deg: float = option(43.53, "Latitude of the scene's centre", name="lat", unit="deg", metavar="DEG")
    mean_height_m: float = option(250.0, "Mean ellipsoidal height", name="height", unit="m", metavar="M")
    landform: str = option(
        "farmland", "Kind of terrain: relief, and whether there are buildings", choices=tuple(LANDFORMS)
    )
    relief_m: float | None = option(
        None,
        "Range of heights of the relief; by default that of the landform: 1000, 300, 100, 30 and 2 m",
        name="relief",
        minimum=0.0,
        unit="m",
        metavar="M",
    )
    cliff_m: float = option(0.0, "Height of cliffs; 0 makes none", name="cliffs", minimum=0.0, unit="m", metavar="M")
    seed: int = option(1, "The same seed and options give the same block", minimum=0, metavar="N")
    half_extent_m: float | None = None
    post_m: float | None = None
    scale: float | None = None
    change: float = 0.0

    def __post_init__(self) -> None:
        if not (-360.0 <= self.lon_deg <= 360.0 and abs(self.lat_deg) <= 90.0):
            raise InputError(
                f"scene centre {self.lon_deg}, {self.lat_deg} is not a place: give degrees, east and north"
            )
        if self.landform not in LANDFORMS:
            raise InputError(f"landform {self.landform!r} is unknown: give one of {', '.join(LANDFORMS)}")
        if (self.relief_m or 0.0) < 0.0 or self.cliff_m < 0.0:
            raise InputError(f"relief {self.relief_m} m and cliffs {self.cliff_m} m must not be negative")
        if not 0.0 <= self.change <= 1.0:
            raise InputError(f"change {self.change} of the scene between dates: give a share of 0 to 1")

    @property
    def relief_range_m(self) -> float:
        """Range of heights of the relief."""
        return LANDFORMS[self.landform].relief_m if self.relief_m is None else self.relief_m


@options
class PointCounts:
    """How many points a block gets; every tie point is on two images or more."""

    gcps: int = option(10, "Number of GCPs, each a disc on the ground", minimum=0, metavar="N")
    checks: int = option(50, "Number of check points", minimum=0, metavar="N")
    ties: int = option(200, "Number of tie points", minimum=0, metavar="N")


@options
class Noise:
    """Errors of the measurements; standard deviations of normal errors, and shares of gross ones."""

    image_px: float = option(
        0.3, "Standard deviation of image coordinates", name="noise-image", minimum=0.0, unit="px", metavar="PX"
    )
    gcp_xy_m: float = option(
        0.1,
        "Standard deviation of each horizontal coordinate of known points",
        name="noise-gcp-xy",
        minimum=0.0,
        unit="m",
        metavar="M",
    )
    gcp_h_m: float = option(
        0.15, "Standard deviation of the height of known points", name="noise-gcp-h", minimum=0.0, unit="m", metavar="M"
    )
    blunders: float = option(
        0.0, "Share of tie measurements that are gross errors", minimum=0.0, maximum=1.0, metavar="SHARE"
    )
    gcp_blunders: float = option(
        0.0, "Share of GCP measurements that are gross errors", minimum=0.0, maximum=1.0, metavar="SHARE"
    )
    blunder_px: float = option(
        30.0, "Mean size of gross errors", name="blunder-size", minimum=0.0, unit="px", advanced=True, metavar="PX"
    )
    wrong_heights: float = option(0.0, "Share of GCPs with a wrong height", minimum=0.0, maximum=1.0, metavar="SHARE")
    wrong_height_m: float = option(
        25.0, "Size of wrong heights", name="wrong-height-size", minimum=0.0, unit="m", advanced=True, metavar="M"
    )
    vendor: float = option(
        1.0,
        "Errors of the vendor's orbit and attitude, as a multiple of the sensor's usual ones; 0 gives exact RPCs",
        name="vendor-error",
        minimum=0.0,
        metavar="FACTOR",
    )

    def __post_init__(self) -> None:
        for name in ("image_px", "gcp_xy_m", "gcp_h_m", "vendor"):
            if getattr(self, name) < 0.0:
                raise InputError(f"simulation noise {name} is {getattr(self, name)}: give 0 or more")
        for name in ("blunders", "gcp_blunders", "wrong_heights"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise InputError(f"simulation share {name} is {getattr(self, name)}: give 0 to 1")


@options
class LaserSpec:
    """Which laser points a scene gets."""

    passes: int = option(
        0, "Passes of a laser altimeter over the scene, six beams each", name="laser-passes", minimum=0, metavar="N"
    )
    canopy: float = option(
        0.1,
        "Share of the laser points that met canopy",
        name="laser-canopy",
        minimum=0.0,
        maximum=1.0,
        advanced=True,
        metavar="SHARE",
    )
    segment_m: float = option(
        40.0,
        "Length of the segments whose mean height a laser point is",
        name="laser-segment",
        minimum=1.0,
        unit="m",
        advanced=True,
        metavar="M",
    )
    clouds: float = option(
        0.03,
        "Share of the laser points that met clouds",
        name="laser-clouds",
        minimum=0.0,
        maximum=1.0,
        advanced=True,
        metavar="SHARE",
    )


@options
class FreeDemSpec:
    """What a free DEM of a scene is like."""

    cell_m: float = option(
        0.0, "Cell size of a DEM as free ones are; 0 writes none", name="free-dem", minimum=0.0, unit="m", metavar="M"
    )
    trees: float = option(
        0.2,
        "Share of the free DEM's cells with trees",
        name="free-dem-trees",
        minimum=0.0,
        maximum=1.0,
        advanced=True,
        metavar="SHARE",
    )
    tree_m: float = option(
        10.0,
        "Height of the trees in the free DEM",
        name="free-dem-tree-height",
        minimum=0.0,
        unit="m",
        advanced=True,
        metavar="M",
    )
    noise_m: float = option(
        1.0,
        "Standard deviation of the free DEM's heights on flat ground; three times that on slopes of 40 %",
        name="free-dem-noise",
        minimum=0.0,
        unit="m",
        advanced=True,
        metavar="M",
    )
    correlation_m: float = option(
        300.0,
        "Distance at which the correlation of these errors has fallen to 1/e; 0: each cell has its own",
        name="free-dem-correlation",
        minimum=0.0,
        unit="m",
        advanced=True,
        metavar="M",
    )
    common_m: float = option(
        2.0,
        "Standard deviation of the common height error of the free DEM (GLO-30: 4 m LE90, with the noise)",
        name="free-dem-common",
        minimum=0.0,
        unit="m",
        advanced=True,
        metavar="M",
    )
    place_m: float = option(
        2.8,
        "Standard deviation of each coordinate in plan by which the free DEM is displaced (GLO-30: 6 m CE90)",
        name="free-dem-place",
        minimum=0.0,
        unit="m",
        advanced=True,
        metavar="M",
    )


@options
class FreeOrthoSpec:
    """What a free orthoimage of a scene is like."""

    pixel_m: float = option(
        0.0,
        "Pixel size of an orthoimage as free ones are; 0 writes none",
        name="free-ortho",
        minimum=0.0,
        unit="m",
        metavar="M",
    )
    error_m: float = option(
        5.0,
        "Root mean square displacement of the free orthoimage",
        name="free-ortho-error",
        minimum=0.0,
        unit="m",
        advanced=True,
        metavar="M",
    )
    corner_m: float = option(
        0.0,
        "Displacement of the north-eastern corner of the free orthoimage against the rest of it",
        name="free-ortho-corner",
        minimum=0.0,
        unit="m",
        advanced=True,
        metavar="M",
    )
    change: float = option(
        0.4,
        "How much of the ground looks different in the free orthoimage, as in another season",
        name="free-ortho-change",
        minimum=0.0,
        maximum=1.0,
        advanced=True,
        metavar="SHARE",
    )
