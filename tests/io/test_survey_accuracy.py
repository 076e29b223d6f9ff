"""Standard deviations, correlations and covariances of ground points, from CSV and layers."""

from pathlib import Path

import numpy as np
import pytest
from gdal_files import write_layer

from hrsi.hrsi_engine.foundation.errors import InputError
from hrsi.hrsi_engine.io.point_files import read_points

ROWS = {"A": (5.0, 44.0, 100.0), "B": (5.1, 44.1, 120.0), "C": (5.2, 44.0, 90.0)}


def points(tmp_path: Path, fields: dict[str, list]):
    """Read a CSV with three points and more fields."""
    lines = [",".join(["id,lon,lat,height", *fields])]
    for number, (name, place) in enumerate(ROWS.items()):
        cells = [name, *map(str, place), *(str(values[number]) for values in fields.values())]
        lines.append(",".join(cells))
    path = tmp_path / "points.csv"
    path.write_text("\n".join(lines))
    return read_points(str(path), height_datum="ellipsoidal").ground


def test_sigmas_alone_need_no_covariance(tmp_path):
    ground = points(tmp_path, {"sigma_xy": [0.1, 0.2, ""], "sigma_h": [0.3, "", 0.5]})
    assert ground.covariance_m2 is None
    np.testing.assert_array_equal(ground.sigma_m, [[0.1, 0.3], [0.2, np.nan], [np.nan, 0.5]])


def test_east_and_north_may_differ(tmp_path):
    ground = points(tmp_path, {"sigma_east": [0.1, "", 0.2], "sigma_north": [0.3, "", ""], "sigma_xy": [9, 0.5, 0.4]})
    # B has sigma_xy only, C its own sigma east; the height takes the option's value
    np.testing.assert_allclose(ground.covariance_m2[:, 0, 0], [0.01, 0.25, 0.04])
    np.testing.assert_allclose(ground.covariance_m2[:, 1, 1], [0.09, 0.25, 0.16])
    assert np.isnan(ground.covariance_m2[:, 2, 2]).all()
    np.testing.assert_allclose(ground.sigma_m[:, 0], np.sqrt([0.05, 0.25, 0.1]))


def test_correlations_and_covariances_say_the_same(tmp_path):
    by_correlation = points(
        tmp_path,
        {"sigma_east": [0.1] * 3, "sigma_north": [0.2] * 3, "sigma_h": [0.4] * 3, "corr_en": [0.5, "", -0.9],
         "corr_eh": [0.1] * 3, "corr_nh": ["", 0.2, 0.3]},
    ).survey_covariance_m2()  # fmt: skip
    by_elements = points(
        tmp_path,
        {"cov_ee": [0.01] * 3, "cov_nn": [0.04] * 3, "cov_hh": [0.16] * 3, "cov_en": [0.01, "", -0.018],
         "cov_eh": [0.004] * 3, "cov_nh": ["", 0.016, 0.024]},
    ).survey_covariance_m2()  # fmt: skip
    expected = [[0.01, 0.01, 0.004], [0.01, 0.04, 0.0], [0.004, 0.0, 0.16]]
    np.testing.assert_allclose(by_correlation[0], expected, atol=1e-15)
    np.testing.assert_allclose(by_elements, by_correlation, atol=1e-15)


def test_infinite_sigmas_are_coordinates_without_survey(tmp_path):
    ground = points(tmp_path, {"sigma_xy": [0.1, "inf", 0.2], "sigma_h": ["inf", 0.3, 0.3]})
    assert ground.sigma_m.tolist() == [[0.1, np.inf], [np.inf, 0.3], [0.2, 0.3]]


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"corr_en": [0.5, 0, 0]}, r"line 2 \(id 'A'\): field 'corr_en' needs the standard deviations of both"),
        ({"sigma_xy": [1, 1, 1], "corr_en": [0, 1.0, 0]}, r"id 'B'\): field 'corr_en' is no correlation"),
        ({"sigma_xy": [1, 1, 1], "cov_en": [0, 0, 2]}, r"id 'C'\): field 'cov_en' is no correlation"),
        ({"sigma_east": [0.1, -1, 1]}, r"id 'B'\): field 'sigma_east' is -1"),
        ({"cov_hh": [0.1, 0, 1]}, r"id 'B'\): field 'cov_hh' is 0"),
        ({"cov_hh": ["inf", 1, 1]}, "'inf' is not a number"),
    ],
)
def test_what_cannot_be_is_named(tmp_path, fields, message):
    with pytest.raises(InputError, match=message):
        points(tmp_path, fields)


def test_layers_have_the_fields_too(tmp_path):
    fields = {"id": [*ROWS], "sigma_e": [0.1] * 3, "sigma_n": [0.2] * 3, "sigma_z": [float("inf")] * 3}
    write_layer(tmp_path / "p.gpkg", "GPKG", "EPSG:4979", np.array([*ROWS.values()]), fields | {"corr_en": [0.5] * 3})
    ground = read_points(str(tmp_path / "p.gpkg"), height_datum="ellipsoidal").ground
    np.testing.assert_allclose(ground.covariance_m2[0, :2, :2], [[0.01, 0.01], [0.01, 0.04]])
    assert np.isinf(ground.covariance_m2[:, 2, 2]).all()
