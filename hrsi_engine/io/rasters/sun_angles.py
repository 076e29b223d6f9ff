"""Sun position of an image: as stated in its delivery, otherwise from time and place of the acquisition.

Deliveries write the same two angles in many ways: `MEANSUNAZ` (ISD XML, .IMD), `SUN_AZIMUTH` (DIMAP, once for each
located value), "Sun Angle Azimuth" (IKONOS, GeoEye), `NITF_USE00A_SUN_AZ`, `sun_azimuth` (JSON). Only these names are
used here, not the formats: each is searched in the text of the image's side files, and in its GDAL metadata. The mean
of several values is used. Times are found in the same way, or in the file's name. The time
in the header of a NITF file (IDATIM) is not used: of two available files one is twelve years older than the satellite,
and the other contradicts the angles in the same file by 20 degrees.
"""

import os
import re
from collections.abc import Iterator
from contextlib import suppress
from datetime import UTC, datetime
from typing import NamedTuple

import numpy as np

from ...camera.rpc import RPC
from ...foundation.errors import InputError
from ...ground.sun import SunAngles, sun_at_time
from ..opening.datasets import metadata_of, open_dataset
from ..opening.files import read_text
from ..opening.item_images import item_of
from ..rpc_files.content import siblings

_NUMBER = r"[-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?"
#: After a name: the rest of an XML tag, or the separators of JSON, PVL, Python and plain text.
_TO_VALUE = r"(?:\s[^<>\n]{0,200})?[\"']?\s*[>=:]\s*[\"']?"
_SUN = r"(?:mean_?)?(?:sun|solar)[ _]?(?:angle[ _]?)?"
_AZIMUTH = re.compile(rf"(?<![a-z])(?:{_SUN}az(?:imuth)?|illuminationAzimuthAngle){_TO_VALUE}({_NUMBER})", re.I)
_ELEVATION = re.compile(
    rf"(?<![a-z])(?:{_SUN}el(?:ev(?:ation)?)?|illuminationElevationAngle){_TO_VALUE}({_NUMBER})", re.I
)
_LINE_RATE = re.compile(rf"(?<![a-z])(avg_?line_?rate|line_period){_TO_VALUE}({_NUMBER})", re.I)
_LONGEST_LINE_S = 0.01  # lines of SPOT take 0.0015 s, those of Pleiades 0.07 ms
_DATE, _CLOCK = r"(\d{4})-?(\d\d)-?(\d\d)", r"(\d\d):?(\d\d):?(\d\d(?:\.\d+)?)?"
_TIME_NAMES = "FIRSTLINETIME|ACQUISITIONDATETIME|Acquisition Date/Time|acquisition_date|acquired|acquisitionTime"
_TIMES = (
    re.compile(rf"(?<![a-z])(?:{_TIME_NAMES}){_TO_VALUE}{_DATE}[T ]?{_CLOCK}", re.I),
    re.compile(rf"IMAGING_DATE{_TO_VALUE}{_DATE}.*?IMAGING_TIME{_TO_VALUE}{_CLOCK}", re.S),
)
#: File names with a time: Airbus (``PHR1B_P_201709281038393_SEN``), then Planet (``20191015_073816_ssc1``).
_TIMES_IN_NAMES = (
    re.compile(r"(?:PHR1|SPOT|PNEO|S[67])[^/]*_(\d{4})(\d\d)(\d\d)(\d\d)(\d\d)(\d\d)\d"),
    re.compile(r"(?:^|/)(20\d\d)(\d\d)(\d\d)_(\d\d)(\d\d)(\d\d)_"),
)
_MAXAR_NAME = re.compile(r"(?:^|/)(\d\d)([A-Z]{3})(\d\d)(\d\d)(\d\d)(\d\d)-[PMS]")
_MONTHS = ("JAN", "FEB", "MAR", "APR", "MAY", "JUN", "JUL", "AUG", "SEP", "OCT", "NOV", "DEC")


class SunReading(NamedTuple):
    """Sun angles of an image, and the source that states them."""

    angles: SunAngles
    source: str


def read_sun(path: str, rpc: RPC | None) -> SunReading | None:
    """Return the sun position of an image, or of the image of an RPC file; None if it cannot be determined.

    The angles as stated; otherwise computed from the acquisition time at the centre of the RPC.
    """
    texts = [*_read_texts(path)]
    for source, text in texts:
        stated = _read_angles(text)
        if stated is not None:
            return SunReading(stated, source)
    if rpc is None:
        return None
    times = [(source, _time_in(text)) for source, text in texts]
    for source, time in (*times, ("the name of the file", _time_of_name(path))):
        if time is not None and (sun := sun_at_time(time, rpc.long_off, rpc.lat_off)).elevation_deg > 0.0:
            return SunReading(sun, f"{source}, by the time {time:%Y-%m-%d %H:%M:%S} UTC")
    return None


def read_time(path: str) -> datetime | None:
    """Return the acquisition time (UTC) from the delivery or the file's name; None if neither states it."""
    times = (_time_in(text) for _source, text in _read_texts(path))
    return next((time for time in times if time is not None), None) or _time_of_name(path)


def read_line_rate(path: str) -> float | None:
    """Return the lines per second of an image's sensor as the delivery states them; None if it does not.

    Maxar states a rate (`avgLineRate`), Airbus the time of a line (`LINE_PERIOD`, in s for SPOT 5, else in ms).
    """
    for _source, text in _read_texts(path):
        if (match := _LINE_RATE.search(text)) and (value := float(match[2])) > 0.0:
            period = match[1].lower() == "line_period"
            return (1.0 if value < _LONGEST_LINE_S else 1000.0) / value if period else value
    return None


def _read_texts(path: str) -> Iterator[tuple[str, str]]:
    """Yield source and text of all metadata of an image: its STAC item, its own metadata, its side files."""
    if (item := item_of(path)) is not None:
        yield f"the STAC item {item.id}", item.sun_text()
    dataset, _message = open_dataset(path)
    if dataset is not None:
        for domain in ("", "IMD", "IMAGERY"):
            metadata = metadata_of(dataset, domain)
            if metadata:
                source_text = f"{domain or 'default'} metadata of {os.path.basename(path)}"
                yield source_text, "\n".join(f"{name}={value}" for name, value in metadata.items())
    files = siblings(path)
    # Names, in lower case, of side files that may contain the sun angles
    stem = os.path.splitext(os.path.basename(path))[0].lower()
    product = re.sub(r"_r\d{1,3}c\d{1,3}$", "", re.sub("^(?:img|rpc|dim)_", "", stem))
    names = (
        f"{stem}.imd",
        f"{stem}.xml",
        f"dim_{product}.xml",
        f"{stem}_metadata.txt",
        re.sub(r"_(?:pan|red|grn|blu|nir|rgb|bgrn)_\d+.*$", "", stem) + "_metadata.txt",
        f"{stem}_metadata.json",
        f"{stem}.json",
        f"{stem}.geom",
    )
    for name in names:
        if name in files:
            with suppress(InputError):  # too large or unreadable: not worth an error
                yield os.path.basename(files[name]), read_text(files[name])


def _read_angles(text: str) -> SunAngles | None:
    """Return the angles that a text states, the mean if there are several; None if missing or impossible."""
    azimuths, elevations = ([float(value) for value in rule.findall(text)] for rule in (_AZIMUTH, _ELEVATION))
    if not azimuths or not elevations:
        return None
    turn = np.exp(1j * np.radians(azimuths)).sum()  # 359 and 1 degrees have the mean 0
    angles = SunAngles(float(np.degrees(np.angle(turn)) % 360.0), float(np.mean(elevations)))
    possible = all(-360.0 <= value <= 360.0 for value in azimuths) and 0.0 < angles.elevation_deg <= 90.0
    return angles if possible else None


def _time_in(text: str, rules: tuple[re.Pattern[str], ...] = _TIMES) -> datetime | None:
    match = next(filter(None, (rule.search(text) for rule in rules)), None)
    return None if match is None else _parse_time(*match.groups())


def _time_of_name(path: str) -> datetime | None:
    name = os.path.basename(path)
    if (match := _MAXAR_NAME.search(name)) and match[2] in _MONTHS:
        return _parse_time(f"20{match[1]}", str(_MONTHS.index(match[2]) + 1), *match.groups()[2:])
    return _time_in(name, _TIMES_IN_NAMES)


def _parse_time(year: str, month: str, day: str, hour: str, minute: str, second: str | None) -> datetime | None:
    try:
        return datetime(int(year), int(month), int(day), int(hour), int(minute), int(float(second or 0.0)), tzinfo=UTC)
    except ValueError:  # digits that are no time
        return None
