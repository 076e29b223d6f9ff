"""A priori pointing accuracy of a sensor, and its change over an image (drift), from the RPC or from publications.

**Pointing.** ERR_BIAS of an RPC is the standard deviation of each horizontal coordinate. If it is missing, the sensor
is identified by the names of its files, and its published accuracy without ground control is used (`PUBLISHED`); CE90
is 2.146 standard deviations of a coordinate. For an unknown sensor the median of the published figures is used,
`POINTING.unknown_m`, in metres on the ground, since the resolution is arbitrary.

**Drift.** ERR_RAND is the standard deviation of the error's variation within an image: for a linear change by d from
one end to the other it is d / sqrt(12). If it is missing, the drift is derived from the pointing error. Both are
published for two sensors (Smiley 2009, of the strips of each quarter from 2006 to 2008): the pointing error of
QuickBird is 14 to 21 m (CE90), and its largest change along a strip 12 to 24 m; for WorldView-1 it is 4.0 to 5.3 m, and
1.8 to 4.8 m. The number of strips is not published. Of about fifty values the largest is 2.8 standard deviations, so
the changes are 6.4 m relative to 8.2 m, and 1.2 m relative to 2.2 m: over a strip the error changes by about
`POINTING.strip_share` of its size. The length of the strips is not published either; 100 km is a usual one. Between an
image and a strip the error of gyroscopes grows with the square root of the time; within a second of flight,
`POINTING.smooth_m`, it is smooth and grows linearly.
"""

import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np

from ..foundation.thresholds import threshold, thresholds
from .block import Image, stack_rpcs

SIGMAS_OF_CE90 = 2.1460  # sqrt(2 ln 10)


@thresholds
class POINTING:
    """A priori accuracy and attitude drift of sensors without stated accuracy."""

    unknown_m: float = threshold(
        7.0,
        "m",
        "standard deviation of the pointing of an unknown sensor",
        "median of the published CE90s, 15 m (`PUBLISHED`)",
    )
    strip_share: float = threshold(0.65, "", "change of the pointing error along a strip", "Smiley 2009, QuickBird")
    strip_m: float = threshold(100e3, "m", "length of this strip: usual for these satellites")
    smooth_m: float = threshold(7e3, "m", "length up to which the change is linear in time: a second of flight")
    least_drift: float = threshold(
        3e-5,
        "px/px",
        "smallest a priori drift: attitude, and errors of the RPC's fit",
        "variance components: IKONOS 2.9e-5, Pleiades 1.9e-5, SPOT 7 2.7e-5 (docs/adjustment.md)",
    )


class SensorAccuracy(NamedTuple):
    """Published accuracy of a sensor.

    ce90_m : CE90 without ground control; source : publication
    name_pattern : regular expression that identifies the sensor by the names of its files
    drift : drift of its error across an image, px/px, and publication; None if none is published
    """

    title: str
    ce90_m: float
    source: str
    name_pattern: str
    drift: tuple[float, str] | None = None


_SMILEY = "B. Smiley: The absolute and relative geolocation accuracies of QB02 and WV01, DigitalGlobe 2009"
_AGUILAR = "M. Aguilar et al. on GeoEye-1 and WorldView-1/2/3/4: direct geolocation better than 5.0 m CE90"
_HANLEY = "Hanley and Fraser, Sensor orientation for HRSI, ISPRS 2004: sub-pixel with a shift; half a pixel taken"
_KOMPSAT = "SI Imaging Services, white paper: Geolocation accuracy of KOMPSAT, Q2 2013"
#: Separately published drifts.
_DRIFTS = {"IKONOS": (0.5 / 11_000.0, _HANLEY)}
#: By title. In file names a sensor's name must not follow a letter or digit.
PUBLISHED = tuple(
    SensorAccuracy(title, ce90_m, source, rf"(?<![a-z0-9])(?:{name_pattern})", _DRIFTS.get(title))
    for title, ce90_m, source, name_pattern in (
        ("IKONOS", 15.0, "GeoInformatics 2/2008, p. 53: Geo Ortho Kit, 15 m CE90", r"ikonos|ik0?[12](?!\d)|po_\d{5}"),
        ("QuickBird", 17.5, f"{_SMILEY}: 14 to 21 m", r"quickbird|qb_?0?2(?!\d)"),
        ("WorldView-1", 4.7, f"{_SMILEY}: 4.0 to 5.3 m", r"worldview[-_ ]?0?1|wv_?0?1(?!\d)"),
        ("WorldView-2", 5.0, _AGUILAR, r"worldview[-_ ]?0?2|wv_?0?2(?!\d)"),
        ("WorldView-3", 3.5, "ISPRS Archives XLI-B1, 429 (2016): predicted below 3.5 m CE90",
         r"worldview[-_ ]?0?3|wv_?0?3(?!\d)"),
        ("WorldView-4", 5.0, _AGUILAR, r"worldview[-_ ]?0?4|wv_?0?4(?!\d)"),
        ("GeoEye-1", 5.0, _AGUILAR, r"geoeye|ge_?0?1(?!\d)"),
        ("Pleiades Neo", 12.0, "none found: as Pleiades, its predecessor", r"pneo|pleiades[-_ ]?neo"),
        ("Pleiades", 12.0, "ISPRS Archives XXXVI Part 1 (2006), CNES: specified 12 m for 90 % of the images",
         r"phr_?1[ab]|phr_sensor|phr(?![a-z0-9])|pleiades"),
        ("SPOT 6/7", 60.0, "none found: as SPOT 5, their predecessor", r"spot[-_ ]?[67]|s[67]_sensor"),
        ("SPOT 5", 60.0, "SPOT5 HRG and HRS first in-flight geometric quality results, CNES 2003: 60 m",
         r"spot[-_ ]?5"),
        ("ZY-3", 15.0, "D. Li, Acta Geodaetica et Cartographica Sinica 41 (2012) 317: better than 15 m", r"zy[-_]?3"),
        ("KOMPSAT-2", 50.9, _KOMPSAT, r"kompsat[-_ ]?2|k2_\d{8}"),
        ("KOMPSAT-3", 48.5, _KOMPSAT, r"kompsat[-_ ]?3|k3a?_\d{8}"),
        ("SkySat", 15.0, "Planet, SkySat mapping and geometric accuracy: 10 to 15 m CE90", r"skysat|ssc?\d+d\d"),
        ("OrbView-3", 20.0, "K. Jacobsen, Geo-information based on very high resolution: 9.3 m a coordinate",
         r"orbview|ov_?3(?!\d)"),
    )
)  # fmt: skip
_ANY_NAME = re.compile("|".join(entry.name_pattern for entry in PUBLISHED))


@dataclass(frozen=True)
class Pointing:
    """A priori pointing accuracy of an image.

    sigma_m : standard deviation of each horizontal coordinate in m
    drift : standard deviation of its change across the image, px per px
    reason : its origin, for messages
    """

    sigma_m: float
    drift: float
    reason: str


def find_sensor(*names: str) -> SensorAccuracy | None:
    """Return the published accuracy of the sensor identified by the first of some names; None if unknown."""
    for name in names:
        if name and _ANY_NAME.search(name.lower()):
            return next(entry for entry in PUBLISHED if re.search(entry.name_pattern, name.lower()))
    return None


def find_image_sensor(image: Image) -> SensorAccuracy | None:
    """Return the published accuracy of an image's sensor, identified by its metadata or names; None if unknown."""
    return find_sensor(image.sensor, os.path.basename(image.path), image.id)


def estimate_pointing(image: Image) -> Pointing:
    """Return the pointing accuracy of an image: from its RPC, from publications on its sensor, or the default."""
    published = find_image_sensor(image)
    stated, varying = image.rpc.err_bias, image.rpc.err_rand
    reasons, drift = [published.title if published else "sensor unknown"], POINTING.least_drift
    if stated:
        sigma_m = stated
        reasons.append(f"ERR_BIAS {stated:.3g} m")
    elif published:
        sigma_m = published.ce90_m / SIGMAS_OF_CE90
        reasons.append(f"CE90 {published.ce90_m:g} m ({published.source})")
    else:
        sigma_m = POINTING.unknown_m
        reasons.append(f"a priori standard deviation {sigma_m:g} m (pointing)")
    if stated or published:
        length_m = float(2.0 * image.camera_half_size_px.max() + 1.0) * compute_gsd_m(image)
        if varying:
            drift = np.sqrt(12.0) * varying / length_m
            reasons.append(f"ERR_RAND {varying:.3g} m")
        elif published and published.drift:
            drift, source = published.drift
            reasons.append(source)
        else:
            smooth_m = max(length_m, POINTING.smooth_m)
            drift = POINTING.strip_share * sigma_m * np.sqrt(smooth_m / POINTING.strip_m) / smooth_m
    drift = max(float(drift), POINTING.least_drift)
    return Pointing(sigma_m, drift, f"{', '.join(reasons)}; a priori {drift:.1e} px/px (attitude drift)")


#: Cache: an adjustment needs the GSD of each image about six times.
_GSDS_M: WeakKeyDictionary[Image, float] = WeakKeyDictionary()


def compute_gsd_m(image: Image) -> float:
    """Return the ground sampling distance at the centre of the RPC's domain, the geometric mean of both axes, m."""
    if image not in _GSDS_M:
        _GSDS_M[image] = float(compute_gsds_m([image])[0])
    return _GSDS_M[image]


def compute_gsds_m(images: Sequence[Image]) -> np.ndarray:
    """Return `compute_gsd_m` of many images, ``(images,)``."""
    if not images:
        return np.empty(0)
    stack = stack_rpcs(images)
    return np.asarray(1.0 / stack.px_per_m(np.arange(len(images)), stack.middles()))
