"""Folders as people have them: init, dry run and run end in a result, or in the one question that init asked.

The block is simulated, so that the roles of all files, the answer to each question and the errors of the refined RPCs
are known. ``make first-contact`` prints the table of all folders.
"""

import shutil
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))

import client_folders
import folders
from client_folders import CLIENT_FOLDERS, MISTAKES
from contact import REAL, Contact, meet, true_error_px
from folders import FOLDERS, Source

from hrsi.processing_algorithms.command_line.cli import main
from hrsi.processing_algorithms.projects.height_evidence import find_installed_geoid, weigh_hypotheses

MEASURED = {"measured.csv": "image measurements"}
#: Roles of files, by folder; where nothing is written, the files of `folders.copy`.
ROLES: dict[str, dict[str, str]] = {
    "text_without_header": {"points.txt": "GCPs: 18", "measured.txt": "image measurements: 54", "dem.tif": "DEM"},
    "geopackage_and_file_per_image": {"survey.gpkg": "GCPs: 18", "image_2_points.txt": "image measurements: 18"},
    "shapefile_and_orthometric_dem": {"punkte.shp": "GCPs: 18", "dtm.tif": "DEM", **MEASURED},
    "geojson_and_nan": {"gcps.geojson": "GCPs: 18", "dem.tif": "DEM", **MEASURED},
    "excel": {"Passpunkte.csv": "GCPs: 18", **MEASURED},
    "georeferencer": {"image_1.tif.points": "GCPs: 18"},
    "control_and_check_apart": {"control_points.csv": "GCPs: 6", "check_points.csv": "check points: 12", **MEASURED},
    "role_column": {"gcps.csv": "ground points with roles: 6 GCPs, 12 check points"},
    "rpc_files_alone": {"image_1_RPC.TXT": "RPC without pixels", "gcps.csv": "GCPs: 18", **MEASURED},
    "without_control": {"dem.tif": "DEM"},
    "orthometric_dem_without_control": {"dem.tif": "DEM"},
    "images_alone": {"image_1.tif": "image"},
    "one_image_alone": {"image_1.tif": "image"},
    "earlier_result": {"old": "earlier result", "gcps.csv": "GCPs: 18"},
    "umlauts_and_blanks": {"Paß punkte (neu).csv": "GCPs: 18", **MEASURED},
    "laser": {"atl06sr.csv": "laser points"},
    "reference_orthoimage": {"orthophoto.tif": "reference orthoimage"},
    "rpc_files_with_tie_points": {"measured.csv": "tie points: 54"},
}
ROLES |= {
    "rpb_beside_images": {"image_1.RPB": "RPC: of image_1.tif", **MEASURED},
    "geom_beside_crops": {"image_1.tif": "image: 256 x 256 px, RPC from OTB .geom", **MEASURED},
    "panchromatic_and_multispectral": {"image_1_ms.tif": "image: 64 x 64 px", **MEASURED},
    "maxar_delivery": {"GIS_FILES/050123456010_01_ORDER_SHAPE.shp": "area", "gcps.csv": "GCPs: 18",
                       "measured.csv": "image measurements: 36"},
    "airbus_delivery": {"VOL_PHR.XML": "unknown", "gcps.csv": "GCPs: 18", "measured.csv": "image measurements: 36",
                        "IMG_PHR1A_P/IMG_PHR1A_P_002/IMG_PHR1A_P_202406011030002_SEN_7654321101-002_R2C2.TIF": "part"},
}  # fmt: skip
READ_AS = "GCPs: 18 ground points; read as the columns "
ROLES |= {
    "zip_beside_delivery": {"050123456010_01.zip": "archive: not used", **ROLES["maxar_delivery"]},
    "zip_alone": {"050123456010_01.zip": "archive: its images are used", "measured.csv": "image measurements: 36"},
    "airbus_volumes": {"gcps.csv": "GCPs: 18", "measured.csv": "image measurements: 36", "DEM/dem.tif": "DEM"},
    "excel_with_units": {"Passpunkte.csv": f"{READ_AS}id, x, y, height, -", **MEASURED},
    "comments_and_units": {"gcps.csv": f"{READ_AS}id, lon, lat, height, -", **MEASURED},
    "swapped_columns": {"gcps.csv": f"{READ_AS}id, lat, lon, height", **MEASURED},
    "lambert_shapefile": {"points_appui.shp": "GCPs: 18", **MEASURED},
    "lambert_text": {"points_appui.csv": f"{READ_AS}id, x, y, height; CRS EPSG:2154", **MEASURED},
    "foreign_fields": {"points.shp": "GCPs: 18 ground points; columns id=MATRICULE,height=ALT_M; CRS EPSG:2154",
                       **MEASURED},
    "spreadsheet": {"gcps.xlsx": "GCPs: 18", **MEASURED},
    "spreadsheets_only": {"gcps.xlsx": "GCPs: 18", "mesures.ods": "image measurements: 54"},
    "gps_waypoints": {"waypoints.gpx": "GCPs: 18", **MEASURED},
    "kml_placemarks": {"gcps.kml": "GCPs: 18", **MEASURED},
    "dem_tiles": {"dtm_0_0.tif": "DEM: 54 x 54", **MEASURED},
    "dem_tiles_in_vrt": {"dtm.vrt": "DEM: 108 x 108", "tiles/dtm_0_1.tif": "part of dtm.vrt", **MEASURED},
    "copernicus": {"Copernicus_DSM_COG_10_N43_00_E005_00_DEM.tif": "DSM", **MEASURED},
    "ascii_dem_without_crs": {"dtm.asc": "DEM: 109 x 109 cells, WGS 84 (EPSG:4326", **MEASURED},
    "long_names": {"Projekt Größe (Endfassung)/Paßpunkte.csv": "GCPs: 18",
                   "Projekt Größe (Endfassung)/Messungen im Bild.csv": "image measurements: 54"},
    "one_broken_rpc": {"image_3.tif": "image, not used", "image_3_RPC.TXT": "RPC: not used: LINE_DEN", **MEASURED},
    "quick_looks": {"image_1_preview.tif": "preview", "image_1.jpg": "metadata", **MEASURED},
    "folders_of_kinds": {"02_GCP/survey.csv": "GCPs: 18", "02_GCP/pixel.csv": "image measurements: 54"},
    "one_file_of_everything": {"points.csv": "ground points with roles: 6 GCPs, 12 check points"},
    "georeferencer_with_crs": {"image_1.points": "GCPs: 18 ground points, with their measurements"},
    "points_not_measured": {"gcps.csv": "GCPs: 18"},
    "two_surveys": {"gcps_2019.csv": "ground points, not used", "gcps.csv": "GCPs: 18", **MEASURED},
    "holes_and_zeros": {"gcp.txt": "GCPs: 18", "mesures.txt": "image measurements: 54", "mnt.tif": "DEM: 114 x 114"},
}  # fmt: skip
ROLES |= {
    "csv_per_image_with_pixels": {f"image_{k}.csv": "GCPs: 15 ground points, with their" for k in (1, 2, 3)},
    "text_per_image_with_pixels": {f"image_{k}_gcp.txt": "GCPs: 15 ground points, with their" for k in (1, 2, 3)},
    "png_with_rpc_file": {"image_1.png": "image: 256 x 256 px", "image_1.rpc": "RPC: of image_1.png", **MEASURED},
    "geojson_per_image_with_pixels": {f"gcps_image_{k}.geojson": "GCPs: 15 ground points, with" for k in (1, 2, 3)},
}
AS_COPIED = {"gcps.csv": "GCPs: 18", **MEASURED}
#: Folders whose heights nothing can show: the one question is asked.
ASKED = {"rpc_files_alone", "ascii_dem_without_crs"}
WITHOUT_GCPS = {"without_control", "orthometric_dem_without_control", "images_alone", "laser", "reference_orthoimage",
                "rpc_files_with_tie_points", "points_not_measured"}  # fmt: skip
#: Largest error (px) with GCPs: the noise of 6 GCPs is 0.2 m and 0.3 px of 0.5 m; without them that of a vendor's RPC.
MOST_PX = {True: 1.0, False: 60.0}


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Source:
    return folders.simulate(tmp_path_factory.mktemp("first") / "source")


def check_contact(met: Contact) -> None:
    """Nothing that must never happen, and all roles are there."""
    assert met.faults == [], met.text
    assert bool(met.question) == (met.name in ASKED), met.question
    for file, role in ROLES.get(met.name, AS_COPIED).items():
        assert (met.roles or {}).get(file, "").startswith(role), (file, met.roles)


def lay_out(layout: Callable[[Source, Path], None], source: Source, folder: Path) -> Path:
    layout(source, folder)
    return folder


RUN = (folders.one_image_with_control, folders.rpc_files_alone)


OTHERS = [one for one in (*FOLDERS, *CLIENT_FOLDERS) if one not in RUN]


@pytest.mark.parametrize(
    "layout", [*RUN, *(pytest.param(one, marks=pytest.mark.thorough) for one in OTHERS)], ids=lambda one: one.__name__
)
def test_a_folder_becomes_a_result(layout, source: Source, tmp_path: Path):
    met = meet(layout.__name__, lay_out(layout, source, tmp_path / "folder"))
    if layout in (folders.nothing_usable, client_folders.dem_alone):
        assert met.codes == [2] and "contains no image with an RPC" in met.text and not met.faults
        return
    check_contact(met)
    assert met.codes == [0, 0, 0], met.text
    met.error_px = error = true_error_px(source, tmp_path / "folder")
    if layout is folders.one_image_alone:
        assert met.steps is not None and met.steps["triangulate"] == "left out" and met.steps["orthorectify"] == "done"
        assert met.verdict == "doubtful"
    elif layout is not client_folders.long_names:  # the truth has other names
        assert error < MOST_PX[met.name not in WITHOUT_GCPS], met.text


@pytest.mark.parametrize("layout", MISTAKES, ids=lambda one: one.__name__)
def test_a_mistake_is_named_by_init_and_by_run(layout, source: Source, tmp_path: Path, capsys):
    folder = lay_out(layout, source, tmp_path / "folder")
    assert main(["init", str(folder), "--height-datum", "ellipsoidal"]) == 2
    of_init = capsys.readouterr().err.splitlines()[-1]
    assert main(["run", str(folder), "--no-report"]) in (2, 3)
    of_run = capsys.readouterr().err
    for words in MISTAKES[layout]:
        assert of_init.startswith("ERROR: ") and words in of_init
        assert words in of_run


def test_measurements_of_other_images_are_named(source: Source, tmp_path: Path, capsys):
    folder = lay_out(folders.as_simulated, source, tmp_path / "folder")
    measured = folder / "measured.csv"
    measured.write_text(measured.read_text().replace("image_", "scene_of_june_"))
    assert main(["init", str(folder), "--height-datum", "ellipsoidal"]) == 2
    shown = capsys.readouterr()
    told = "names the images scene_of_june_1, scene_of_june_2, scene_of_june_3; those here are image_1, image_2"
    assert told in shown.out + shown.err


def test_a_question_is_not_asked_where_no_answer_helps(source: Source, tmp_path: Path, capsys):
    folder = lay_out(client_folders.heights_in_feet, source, tmp_path / "folder")
    assert main(["init", str(folder)]) == 2
    shown = capsys.readouterr()
    assert "question:" not in shown.err + shown.out
    assert "ERROR: the heights of the ground points are in feet" in shown.err


@pytest.mark.real
@pytest.mark.parametrize("name", REAL)
def test_a_real_folder_becomes_a_result(name: str, real_data: Path, tmp_path: Path):

    shutil.copytree(real_data / name, tmp_path / name)
    met = meet(name, tmp_path / name, run=name in ("qb2_gcp", "zy3_stereo_gcp"))
    assert met.faults == [] and set(met.codes) == {0}, met.text
    assert bool(met.question) == (name == "zy3_stereo_gcp")


def test_heights_without_datum_are_weighed_with_the_chance_of_an_agreement():
    """Differences of 0 and -N: decided where N is large for the common error, left open where it is not."""
    lonlat = np.array([5.45, 43.53]) + np.random.default_rng(1).uniform(-0.01, 0.01, (20, 2))
    geoid = find_installed_geoid(lonlat)
    heights = np.linspace(200.0, 300.0, 20)
    for unknown, datum in ((heights, "ellipsoidal"), (heights - geoid[1], geoid[0])):
        assert weigh_hypotheses(lonlat, heights, unknown, 10.0, "heights").datum == datum
        assert weigh_hypotheses(lonlat, heights + 10.0, unknown, 200.0, "heights").datum is None
    for unknown in (np.full(20, np.nan), heights / 0.3048):  # no heights, feet
        assert weigh_hypotheses(lonlat, heights, unknown, 10.0, "heights").datum is None
