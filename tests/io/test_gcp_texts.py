"""GCP texts of Metashape and OrthoEngine, written as their makers describe them."""

import numpy as np
import pyproj
import pytest

from hrsi.hrsi_engine.block.block import Role
from hrsi.hrsi_engine.foundation.errors import InputError
from hrsi.hrsi_engine.io.point_files import read_points

#: As Metashape writes it: WKT 1 with TOWGS84, names of degrees in full, no AXIS.
WKT = (
    'PROJCS["WGS 84 / UTM zone 32N",GEOGCS["WGS 84",DATUM["World Geodetic System 1984",'
    'SPHEROID["WGS 84",6378137,298.257223563,AUTHORITY["EPSG","7030"]],TOWGS84[0,0,0,0,0,0,0],'
    'AUTHORITY["EPSG","6326"]],PRIMEM["Greenwich",0,AUTHORITY["EPSG","8901"]],'
    'UNIT["degree",0.01745329251994328,AUTHORITY["EPSG","9102"]],AUTHORITY["EPSG","4326"]],'
    'PROJECTION["Transverse_Mercator",AUTHORITY["EPSG","9807"]],PARAMETER["latitude_of_origin",0],'
    'PARAMETER["central_meridian",9],PARAMETER["scale_factor",0.9996],PARAMETER["false_easting",500000],'
    'PARAMETER["false_northing",0],UNIT["metre",1,AUTHORITY["EPSG","9001"]],AUTHORITY["EPSG","32632"]]'
)
UTM = pyproj.Transformer.from_crs(32632, 4326, always_xy=True)


@pytest.mark.parametrize("separator", [",", ";", "\t", " "])
def test_metashape_reference(tmp_path, separator):
    """Rows end where nothing follows; errors and estimates behind the position are not read."""
    header = [
        "#Label",
        "X/Easting",
        "Y/Northing",
        "Z/Altitude",
        "Accuracy_X/Y_(m)",
        "Accuracy_Z_(m)",
        "Error_(m)",
        "X_est",
    ]
    rows = [["P1", "593656.566250", "5089108.835697", "909.422", "0.02", "0.05", "0.1", "593656.6"],
            ["P2", "593700.0", "5089200.5", "900.0", "0.03", "0.06"]]  # fmt: skip
    path = tmp_path / "markers.txt"
    path.write_text("\n".join([f"# CoordinateSystem: {WKT}", *(separator.join(row) for row in [header, *rows])]) + "\n")
    ground = read_points(str(path), height_datum="ellipsoidal").ground
    assert ground.ids.tolist() == ["P1", "P2"]
    lon, lat = UTM.transform([593656.566250, 593700.0], [5089108.835697, 5089200.5])
    np.testing.assert_allclose(ground.ground, np.column_stack([lon, lat, [909.422, 900.0]]), rtol=1e-13)
    np.testing.assert_allclose(ground.sigma_m, [[0.02, 0.05], [0.03, 0.06]])


def test_metashape_reference_in_degrees_and_without_a_system(tmp_path):
    path = tmp_path / "markers.csv"
    path.write_text("#Label,X/Longitude,Y/Latitude,Z/Altitude,\nA,8.5452,47.3975,432.7\n")
    ground = read_points(str(path), height_datum="ellipsoidal").ground
    np.testing.assert_allclose(ground.ground, [[8.5452, 47.3975, 432.7]], rtol=1e-15)
    path.write_text("# Markers\n#Label,X,Y,Z\nA,593656.5,5089108.8,432.7\n")
    ground = read_points(str(path), ground_crs="EPSG:32632", height_datum="ellipsoidal").ground
    np.testing.assert_allclose(ground.ground[0, :2], UTM.transform(593656.5, 5089108.8), rtol=1e-13)
    with pytest.raises(InputError, match="ground_crs"):
        read_points(str(path))
    path.write_text("#Label,X,Y,Z\nA,1,2,3\nB,1,x,3\n")
    with pytest.raises(InputError, match=r"markers\.csv, field 'y', line 3: 'x' is not a number"):
        read_points(str(path), ground_crs="EPSG:32632")


def test_orthoengine_gcps(tmp_path):
    """Blanks, tabs and commas; quoted ids; status; half a pixel off."""
    path = tmp_path / "gcps.txt"
    path.write_text('G1 100.5 200.5 8.5452 47.3975 432.7 0.2 0.4 G\n"big rock",10,20.25\t8.5 47.4 400 1 1 C\n'
                    "G3 1 2 8.6 47.5 1.5E2 1 1 I\n")  # fmt: skip
    tables = read_points(f"{path}|columns=ID,P,L,X,Y,Z,eP,eL,S", image_ids=["img"], ground_crs="EPSG:4326")
    assert tables.ground.ids.tolist() == ["G1", "big rock", "G3"]
    assert tables.ground.role.tolist() == [Role.GCP, Role.CHECK, Role.OFF]
    expected = [[8.5452, 47.3975, 432.7], [8.5, 47.4, 400.0], [8.6, 47.5, 150.0]]
    np.testing.assert_allclose(tables.ground.ground, expected, rtol=1e-15)
    np.testing.assert_allclose(tables.image.xy, [[100.0, 200.0], [9.5, 19.75], [0.5, 1.5]])
    np.testing.assert_allclose(tables.image.sigma_px, [0.2, 1.0, 1.0])
    path.write_text("G1 1 2 8.5 47.4 400 Q\n")
    with pytest.raises(InputError, match=r"gcps\.txt, line 1 .*'Q'"):
        read_points(f"{path}|columns=ID,P,L,X,Y,Z,S", image_ids=["img"], ground_crs="EPSG:4326")
    path.write_text("G1 1 2 8.5 47.4 400\nG2 1 2 8.5 47.4\n")
    with pytest.raises(InputError, match=r"gcps\.txt, line 2: has 5 columns, but 6 columns are named"):
        read_points(f"{path}|columns=ID,P,L,X,Y,Z", image_ids=["img"], ground_crs="EPSG:4326")
