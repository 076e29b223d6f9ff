"""Laser points from granules, GeoParquet and point layers, and what each reader refuses."""

from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from osgeo import gdal

from hrsi.hrsi_engine.foundation.errors import InputError
from hrsi.hrsi_engine.io.laser_files import read_laser
from hrsi.hrsi_engine.plausibility.laser_quality import find_laser_reasons

FILL = 3.4028235e38
COUNT = 30


def write_granule(path: Path, arrays: dict[str, np.ndarray]) -> Path:
    """Write arrays by their paths into a file of HDF5, with GDAL's netCDF driver: netCDF 4 is HDF5."""
    dataset = gdal.GetDriverByName("netCDF").CreateMultiDimensional(str(path), ["FORMAT=NC4"])
    groups = {"": dataset.GetRootGroup()}
    dimensions = {}
    for name, values in arrays.items():
        *parents, leaf = name.split("/")
        for depth in range(1, len(parents) + 1):
            here = "/".join(parents[:depth])
            if here not in groups:
                groups[here] = groups["/".join(parents[: depth - 1])].CreateGroup(parents[depth - 1])
        place = "/".join(parents)
        sizes = []
        for axis, size in enumerate(values.shape):
            key = (place, axis, size)
            if key not in dimensions:
                dimensions[key] = groups[place].CreateDimension(f"{leaf}_{axis}", None, None, size)
            sizes.append(dimensions[key])
        kind = gdal.GDT_Float64 if values.dtype == np.float64 else gdal.GDT_Float32
        array = groups[place].CreateMDArray(leaf, sizes, gdal.ExtendedDataType.Create(kind))
        array.Write(np.ascontiguousarray(values))
    return path


def track(rng: np.random.Generator) -> dict[str, np.ndarray]:
    return {"latitude": 43.5 + 1.8e-4 * np.arange(COUNT), "longitude": 5.4 + 1e-6 * rng.normal(size=COUNT)}


def atl06(path: Path) -> Path:
    rng = np.random.default_rng(1)
    arrays = {}
    for beam in ("gt1l", "gt2r"):
        place = f"{beam}/land_ice_segments"
        height = (200.0 + 0.1 * np.arange(COUNT)).astype(np.float32)
        height[3] = FILL
        quality = np.zeros(COUNT, dtype=np.float32)
        quality[7] = 1.0
        misfit = np.full(COUNT, 0.2, dtype=np.float32)
        misfit[9] = 4.0
        arrays |= {f"{place}/{name}": values for name, values in track(rng).items()}
        arrays |= {
            f"{place}/h_li": height, f"{place}/h_li_sigma": np.full(COUNT, 0.04, dtype=np.float32),
            f"{place}/atl06_quality_summary": quality, f"{place}/fit_statistics/h_rms_misfit": misfit,
            f"{place}/fit_statistics/n_fit_photons": np.full(COUNT, 60.0, dtype=np.float32),
            f"{place}/fit_statistics/dh_fit_dx": np.full(COUNT, 0.005, dtype=np.float32),
        }  # fmt: skip
    return write_granule(path, arrays)


def test_atl06(tmp_path):
    points = read_laser(str(atl06(tmp_path / "ATL06_20200101000000_01230405_006_01.h5")))
    assert len(points) == 2 * (COUNT - 1)  # the filled heights are none
    np.testing.assert_allclose(points.ground[0], [5.4, 43.5, 200.0], atol=1e-4)
    assert set(points.track.tolist()) == {"ATL06_20200101000000_01230405_006_01.h5"}
    np.testing.assert_allclose(points.sigma_m, 0.04, rtol=1e-6)
    reasons = find_laser_reasons(points)
    assert Counter(reasons.tolist()) == {"": 54, "flagged by the product": 2, "photons spread by more than 1 m": 2}


def test_atl08(tmp_path):
    place, rng = "gt3r/land_segments", np.random.default_rng(2)
    cloud, water = np.zeros(COUNT, dtype=np.float32), np.zeros(COUNT, dtype=np.float32)
    cloud[4], water[5] = 3.0, 1.0
    canopy = np.full(COUNT, FILL, dtype=np.float32)
    canopy[6] = 14.0
    arrays = {f"{place}/{name}": values for name, values in track(rng).items()} | {
        f"{place}/terrain/h_te_best_fit": np.full(COUNT, 310.0, dtype=np.float32),
        f"{place}/terrain/h_te_std": np.full(COUNT, 0.5, dtype=np.float32),
        f"{place}/terrain/terrain_slope": np.full(COUNT, 0.02, dtype=np.float32),
        f"{place}/terrain/n_te_photons": np.full(COUNT, 80.0, dtype=np.float32),
        f"{place}/canopy/h_canopy": canopy, f"{place}/cloud_flag_atm": cloud, f"{place}/segment_watermask": water,
    }  # fmt: skip
    points = read_laser(str(write_granule(tmp_path / "ATL08.h5", arrays)))
    reasons = find_laser_reasons(points)
    assert reasons[4] == "cloud over the point"
    assert reasons[5] == "water"
    assert reasons[6] == "vegetation above 3 m"
    assert (reasons == "").sum() == COUNT - 3
    assert np.isnan(points.sigma_m).all()  # h_te_uncertainty is none of the height alone


def test_gedi(tmp_path):
    rng = np.random.default_rng(3)
    quality = np.ones(COUNT, dtype=np.float32)
    quality[2] = 0.0
    heights = np.tile(np.linspace(-2.0, 1.5, 101, dtype=np.float32), (COUNT, 1))
    heights[8] += 12.0
    place = "BEAM0101"
    arrays = {
        f"{place}/lat_lowestmode": track(rng)["latitude"], f"{place}/lon_lowestmode": track(rng)["longitude"],
        f"{place}/elev_lowestmode": np.full(COUNT, 120.0), f"{place}/quality_flag": quality,
        f"{place}/degrade_flag": np.zeros(COUNT, dtype=np.float32), f"{place}/rh": heights,
        f"{place}/sensitivity": np.full(COUNT, 0.97, dtype=np.float32),
    }  # fmt: skip
    points = read_laser(str(write_granule(tmp_path / "GEDI02_A.h5", arrays)))
    reasons = find_laser_reasons(points)
    assert reasons[2] == "flagged by the product"
    assert reasons[8] == "vegetation above 3 m"
    np.testing.assert_allclose(points.sigma_m, 1.0)


def test_csv_of_sliderule_and_of_anyone(tmp_path):
    file = tmp_path / "atl06sr.csv"
    file.write_text(
        "longitude,latitude,h_mean,h_sigma,rms_misfit,n_fit_photons,dh_fit_dx,rgt,cycle\n"
        "5.4,43.5,210.25,0.05,0.2,40,0.01,12,3\n5.4,43.5002,210.5,0,0.2,40,0.01,12,4\n"
    )
    points = read_laser(str(file))
    assert points.track.tolist() == ["rgt 12, cycle 3", "rgt 12, cycle 4"]
    np.testing.assert_allclose(points.ground[:, 2], [210.25, 210.5])
    assert points.sigma_m[0] == 0.05 and np.isnan(points.sigma_m[1])  # a sigma of 0 says nothing
    other = tmp_path / "points.csv"
    other.write_text("id,x,y,height,sigma_h\nA,532327,4816471,210,0.2\n")
    ground = read_laser(str(other), ground_crs="EPSG:32631").ground[0]
    np.testing.assert_allclose(ground, [3.4, 43.5, 210.0], atol=1e-2)


def test_geoparquet(tmp_path):
    parquet, pyarrow = pytest.importorskip("pyarrow.parquet"), pytest.importorskip("pyarrow")
    place = np.zeros(3, dtype=[("order", "u1"), ("code", "<u4"), ("xy", "<f8", (2,))])
    place["order"], place["code"], place["xy"] = 1, 1, [(5.4, 43.5), (5.41, 43.5), (5.42, 43.5)]
    geo = b'{"primary_column": "geometry", "columns": {"geometry": {"encoding": "WKB"}}}'
    table = pyarrow.table({"h_mean": [1.0, None, 3.0], "geometry": [row.tobytes() for row in place]})
    file = tmp_path / "laser.parquet"
    parquet.write_table(table.replace_schema_metadata({b"geo": geo}), file)
    points = read_laser(str(file))
    np.testing.assert_allclose(points.ground, [(5.4, 43.5, 1.0), (5.42, 43.5, 3.0)])
    content = file.read_bytes()
    for cut in (10, len(content) // 2, len(content) - 5):
        file.write_bytes(content[:cut])
        with pytest.raises(InputError, match="GeoParquet"):
            read_laser(str(file))


@pytest.mark.parametrize("content", [b"\x89HDF\r\n\x1a\n" + bytes(200), b"\x89HDF\r\n\x1a\nxyz"])
def test_damaged_granules_are_refused(tmp_path, content):
    file = tmp_path / "ATL06.h5"
    file.write_bytes(content)
    with pytest.raises(InputError, match=r"ATL06\.h5"):
        read_laser(str(file))


def test_a_granule_of_something_else_is_refused(tmp_path):
    file = write_granule(tmp_path / "other.h5", {"gt1l/heights/h_ph": np.zeros(4)})
    with pytest.raises(InputError, match="no granule that is known"):
        read_laser(str(file))


def test_a_layer_without_heights_is_refused(tmp_path):
    file = tmp_path / "flat.csv"
    file.write_text("id,lon,lat\nA,5.4,43.5\n")
    with pytest.raises(InputError, match="no heights"):
        read_laser(str(file))


def test_a_point_that_stands_out_from_its_track(tmp_path):
    file = tmp_path / "track.csv"
    rows = [f"5.4,{43.5 + 1.8e-4 * k:.6f},{200.0 + 0.2 * k + (40.0 if k == 11 else 0.0)},0.1" for k in range(25)]
    file.write_text("\n".join(["lon,lat,height,sigma_h", *rows]))
    reasons = find_laser_reasons(read_laser(str(file)))
    assert np.flatnonzero(reasons != "").tolist() == [11]


def test_the_real_segments_of_utqiagvik(real_data):
    pytest.importorskip("pyarrow.parquet")
    folder = real_data / "icesat2_utqiagvik"
    points = read_laser(str(folder / "atl06sr_canopy.parquet"))
    assert len(points) == 10_527  # README: segments, and percentiles of h_mean
    np.testing.assert_allclose(np.percentile(points.ground[:, 2], [0, 50, 100]), [-19.2, 0.0, 87.9], atol=0.06)
    reasons = find_laser_reasons(points)
    kept = points.ground[reasons == "", 2]
    assert 0.7 < (reasons == "").mean() < 0.9
    assert kept.min() > -6.0 and kept.max() < 30.0  # a flat coast with low hills and a town: clouds are gone
    assert len(read_laser(str(folder / "atl06sr_top_of_canopy.parquet"))) == 1068
