"""Where the sun stood: as deliveries of different vendors write it, and by the time and place of the acquisition."""

import shutil
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import pytest
import simulated_blocks as blocks
from osgeo import gdal

from hrsi.hrsi_engine.ground.sun import sun_at_time
from hrsi.hrsi_engine.io.rasters.sun_angles import read_sun
from hrsi.hrsi_engine.io.rpc_files.find import read_rpc_or_none

#: What vendors print of the sun over two images, and when and where these were taken: rpc_WV2.xml (IMD part) and
#: JAX_068_001_RGB.json of the real data. Vendors round to 0.1 degree; refraction and the latitude meant are 0.2.
PRINTED = (
    (datetime(2015, 9, 30, 10, 56, 57, tzinfo=UTC), -0.3248, 45.6543, 162.1, 40.3),
    (datetime(2014, 10, 5, 16, 1, 38, tzinfo=UTC), -81.6638, 30.3488, 150.3, 50.8),
)
LENIENT_DEG = 0.3
HERE = replace(blocks.oblique_rpc(0.0, 0.0), long_off=-0.3248, lat_off=45.6543)


@pytest.mark.parametrize(("time", "lon", "lat", "azimuth", "elevation"), PRINTED)
def test_time_and_place_give_what_vendors_print(time, lon: float, lat: float, azimuth: float, elevation: float):
    sun = sun_at_time(time, lon, lat)
    assert sun.azimuth_deg == pytest.approx(azimuth, abs=LENIENT_DEG)
    assert sun.elevation_deg == pytest.approx(elevation, abs=LENIENT_DEG)


def image(folder: Path, name: str = "image.tif", **metadata: str) -> str:
    path = str(folder / name)
    dataset = gdal.GetDriverByName("GTiff").Create(path, 8, 8)
    dataset.SetMetadata(metadata)
    return path


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("image.IMD", "BEGIN_GROUP = IMAGE_1\n\tmeanSunAz = 162.1;\n\tmeanSunEl =  40.3;\n\tminSunAz = 10.0;\n"),
        ("image.XML", "<isd><IMD><MINSUNAZ>9</MINSUNAZ><MEANSUNAZ>1.621e+02</MEANSUNAZ><MEANSUNEL>40.3</MEANSUNEL>"
            "</IMD></isd>"),
        ("DIM_image.XML", "".join(
            f'<Solar_Incidences><SUN_AZIMUTH unit="deg">{a}</SUN_AZIMUTH><SUN_ELEVATION unit="deg">{e}</SUN_ELEVATION>'
            "</Solar_Incidences>" for a, e in ((162.0, 40.2), (162.2, 40.4)))),
        ("image_metadata.txt", "Sun Angle Azimuth: 162.1 degrees\nSun Angle Elevation: 40.3 degrees\n"),
        ("image.json", '{"sun_elevation": "+40.3", "sun_azimuth": "162.1", "acquisition_date": "20010101"}'),
    ],
)  # fmt: skip
def test_the_angles_of_a_delivery_are_read(tmp_path: Path, name: str, text: str):
    (tmp_path / name).write_text(text)
    found = read_sun(image(tmp_path), None)
    assert found is not None and (name in found.source or "IMD metadata" in found.source)  # GDAL may read it too
    assert found.angles == pytest.approx((162.1, 40.3), abs=1e-9)


def test_angles_around_north_have_their_mean_in_the_north(tmp_path: Path):
    (tmp_path / "image.xml").write_text(
        "<SUN_AZIMUTH>359</SUN_AZIMUTH><SUN_AZIMUTH>3</SUN_AZIMUTH><SUN_ELEVATION>30</SUN_ELEVATION>"
    )
    assert read_sun(image(tmp_path), None).angles == pytest.approx((1.0, 30.0))


@pytest.mark.parametrize(
    ("name", "metadata"),
    [
        ("image.tif", {"IMAGING_DATE": "2015-09-30", "IMAGING_TIME": "10:56:56.9Z"}),
        ("IMG_PHR1A_P_201509301056570_SEN_1_R1C1.TIF", {}),
        ("20150930_105657_ssc1d3_0011_pan.tif", {}),
        ("15SEP30105657-P1BS-012345.tif", {}),
    ],
)
def test_the_time_of_an_acquisition_tells_the_sun(tmp_path: Path, name: str, metadata: dict[str, str]):
    """In metadata and in the names of vendors' files; without a place it tells nothing."""
    path = image(tmp_path, name, **metadata)
    found = read_sun(path, HERE)
    assert found is not None and "2015-09-30 10:56:5" in found.source
    assert found.angles == pytest.approx((162.1, 40.3), abs=LENIENT_DEG)
    assert read_sun(path, None) is None


@pytest.mark.parametrize(
    ("text", "metadata"),
    [
        ("<SUN_AZIMUTH>162</SUN_AZIMUTH>", {}),  # no elevation: not the sun over an image
        ("<SUN_AZIMUTH>900</SUN_AZIMUTH><SUN_ELEVATION>20</SUN_ELEVATION>", {}),
        ("<MISSION>no sun</MISSION>", {"IMAGING_DATE": "2015-13-30", "IMAGING_TIME": "10:56:56Z"}),
        ("<MISSION>night</MISSION>", {"IMAGING_DATE": "2015-09-30", "IMAGING_TIME": "22:56:56Z"}),
        ("\x00\xff" * 100, {"NITF_IDATIM": "20150930105657"}),  # headers of chips are known to be wrong
    ],
)
def test_what_no_sun_can_be_is_none(tmp_path: Path, text: str, metadata: dict[str, str]):
    (tmp_path / "image.xml").write_text(text, encoding="latin-1")
    assert read_sun(image(tmp_path, **metadata), HERE) is None


def test_real_deliveries(real_data: Path, tmp_path: Path):
    """The vendors' own files: angles of WorldView-2 and of an image with JSON; the time of a Pléiades image."""
    formats = real_data / "formats"
    for file, angles in (
        (formats / "wv_isd_xml" / "rpc_WV2.xml", (162.1, 40.3)),
        (formats / "rpcm_json" / "JAX_068_001_RGB.json", (150.3, 50.8)),
    ):
        shutil.copy(file, tmp_path)
        assert read_sun(image(tmp_path, f"{file.stem}.tif"), None).angles == pytest.approx(angles)
    path = str(real_data / "kahramanmaras_phr4" / "post_event_img2.tif")
    found = read_sun(path, read_rpc_or_none(path).rpc)
    assert "2023-04-15 08:34:39" in found.source and found.angles == pytest.approx((151.2, 59.3), abs=0.1)
