"""Deliveries as they come, through the command line: their files are found, and their cameras are the known ones."""

import json
import zipfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import deliveries
import numpy as np
import pytest

from hrsi.hrsi_engine.camera.rpc import RPC
from hrsi.hrsi_engine.io.rasters.images import open_image
from hrsi.processing_algorithms import run
from hrsi.processing_algorithms.command_line import cli

SIZE = (400, 360)
TILE = (240, 200)


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("scene")
    run("simulate", output_dir=str(folder), size=SIZE[0], lines=SIZE[1], images=2, gcps=8, checks=10, ties=150,
        noise_image=0.05, noise_gcp_xy=0.05, noise_gcp_h=0.05)  # fmt: skip
    return folder


@pytest.fixture(scope="module")
def rpc(scene: Path) -> RPC:
    return open_image(str(scene / "image_1.tif")).rpc


def told(capsys: pytest.CaptureFixture[str], *words: str | Path, code: int = 0) -> tuple[dict[str, Any], str]:
    """Run the command line with a report on standard output; return it and what is said on standard error."""
    capsys.readouterr()
    assert cli.main([*map(str, words), "--json"]) == code
    printed = capsys.readouterr()
    return (json.loads(printed.out) if printed.out else {}), printed.err


def info(capsys: pytest.CaptureFixture[str], *images: Path, height: float | None = 250.0) -> tuple[dict[str, Any], str]:
    """Return what `rpc-info` says of images."""
    return told(capsys, "rpc-info", *images, *([] if height is None else ["--height", str(height)]))


def assert_same_place(found: dict[str, Any], expected: dict[str, Any]) -> None:
    """The middle of an image on the ground, to a millionth of a degree: a tenth of a metre, an eighth of a pixel."""
    assert [found["lon"], found["lat"]] == pytest.approx([expected["lon"], expected["lat"]], abs=1e-6)


@pytest.mark.parametrize("prefix", ["isd", "ns0", ""])
def test_an_isd_with_namespaces_is_read(capsys, scene: Path, rpc: RPC, tmp_path: Path, prefix: str) -> None:
    deliveries.cut_tile(scene / "image_1.tif", tmp_path / "wv.tif", (0, 0, *SIZE))
    (tmp_path / "wv.xml").write_text(deliveries.isd_with_namespace(rpc, prefix))
    report, log = info(capsys, tmp_path / "wv.tif")
    expected, _ = info(capsys, scene / "image_1.tif")
    assert "ISD XML wv.xml" in log
    assert_same_place(report["images"]["wv"], expected["images"]["image_1"])
    report, _ = info(capsys, tmp_path / "wv.xml")  # the file alone
    assert report["images"]["wv"]["rpc_source"] == "ISD XML wv.xml"


@pytest.mark.parametrize("first", [1, 0])
def test_a_dim_without_pixels_names_its_rpc_and_height(capsys, rpc: RPC, tmp_path: Path, first: int) -> None:
    fiction = replace(rpc, height_off=4000.0)  # as in Pleiades Neo: the numbers are normalised about it
    (tmp_path / "RPC_x.XML").write_text(deliveries.dimap_rpc(fiction, first))
    (tmp_path / "DIM_x.XML").write_text(deliveries.dimap_product("RPC_x.XML", SIZE, SIZE, {}, 253.5))
    for file in ("DIM_x.XML", "RPC_x.XML"):
        report, _ = info(capsys, tmp_path / file, height=None)
        (image,) = report["images"].values()
        assert (image["samples"], image["lines"]) == SIZE
        assert image["height_m"] == 253.5


def test_a_dim_whose_rpc_file_is_missing_names_it(capsys, tmp_path: Path) -> None:
    (tmp_path / "DIM_x.XML").write_text(deliveries.dimap_product("RPC_x.XML", SIZE, SIZE, {}))
    _, log = told(capsys, "rpc-info", tmp_path / "DIM_x.XML", code=2)
    assert "DIM_x.XML: names the RPC file 'RPC_x.XML', which is not in its folder" in log


def tiled(scene: Path, rpc: RPC, folder: Path) -> list[Path]:
    """Write a product of 2 x 2 tiles; return the tiles."""
    tiles = {f"IMG_x_R{row}C{column}.TIF": (row, column) for row in (1, 2) for column in (1, 2)}
    for name, (row, column) in tiles.items():
        first = (column - 1) * TILE[0], (row - 1) * TILE[1]
        window = *first, min(TILE[0], SIZE[0] - first[0]), min(TILE[1], SIZE[1] - first[1])
        deliveries.cut_tile(scene / "image_1.tif", folder / name, window)
    (folder / "RPC_x.XML").write_text(deliveries.dimap_rpc(rpc))
    (folder / "DIM_x.XML").write_text(deliveries.dimap_product("RPC_x.XML", SIZE, TILE, tiles, 250.0))
    return [folder / name for name in tiles]


def test_a_folder_of_tiles_is_one_image_of_the_whole_scene(capsys, scene: Path, rpc: RPC, tmp_path: Path) -> None:
    tiled(scene, rpc, tmp_path)
    expected, _ = info(capsys, scene / "image_1.tif")
    with zipfile.ZipFile(tmp_path.parent / "delivery.zip", "w") as archive:
        for file in tmp_path.iterdir():
            archive.write(file, f"IMG_01/{file.name}")
    for delivery in (tmp_path, tmp_path / "DIM_x.XML", tmp_path.parent / "delivery.zip"):
        report, _ = info(capsys, delivery)
        (image,) = report["images"].values()
        assert (image["samples"], image["lines"]) == SIZE
        assert_same_place(image, expected["images"]["image_1"])


def test_tiles_of_a_scene_are_adjusted_as_one_camera(capsys, scene: Path, rpc: RPC, tmp_path: Path) -> None:
    """Adjusted as tiles, each point is where the whole image's RPC has it: also by a model about the image's middle."""
    tiles = tiled(scene, rpc, tmp_path)
    rows = [line.split(",") for line in (scene / "image_points.csv").read_text().splitlines()]
    header, split = rows[0], [rows[0]]
    image, sample, line = (header.index(name) for name in ("image", "sample", "line"))
    for row in rows[1:]:
        if row[image] == "image_1":
            at = float(row[sample]), float(row[line])
            place = int(at[0] > TILE[0] - 0.5), int(at[1] > TILE[1] - 0.5)
            row[image] = f"IMG_x_R{place[1] + 1}C{place[0] + 1}"
            row[sample], row[line] = str(at[0] - place[0] * TILE[0]), str(at[1] - place[1] * TILE[1])
        split.append(row)
    (tmp_path / "points.csv").write_text("\n".join(map(",".join, split)))
    common = ["--gcps", scene / "ground_points.csv", "--model", "affine", "--write", "sidecar", "--reject", "0",
              "--no-test-sigmas", "--force-write"]  # fmt: skip
    whole, parts = tmp_path / "whole", tmp_path / "parts"
    told(capsys, "adjust", scene / "image_1.tif", scene / "image_2.tif", "--image-points", scene / "image_points.csv",
         "--output-dir", whole, *common)  # fmt: skip
    _, log = told(capsys, "adjust", *tiles, scene / "image_2.tif", "--image-points", tmp_path / "points.csv",
                  "--tie-points", "none", "--output-dir", parts, *common)  # fmt: skip
    assert "IMG_x_R1C1, IMG_x_R1C2, IMG_x_R2C1, IMG_x_R2C2: tiles of one scene, adjusted as one camera" in log
    refined = open_image(str(whole / "image_1_RPC.TXT")).rpc
    xy = np.stack(np.meshgrid([0.0, 200.0, 399.0], [0.0, 180.0, 359.0]), axis=-1).reshape(-1, 2)
    ground = refined.localize(xy, 250.0).ground
    for row in (1, 2):
        for column in (1, 2):
            tile = open_image(str(parts / f"IMG_x_R{row}C{column}_RPC.TXT")).rpc
            first = (column - 1) * TILE[0], (row - 1) * TILE[1]
            np.testing.assert_allclose(tile.project(ground) + first, xy, atol=2e-3)


def test_a_spot_5_scene_without_rpc_is_called_what_it_is(capsys, tmp_path: Path) -> None:
    (tmp_path / "METADATA.DIM").write_text(deliveries.spot5_product())
    for name in (tmp_path / "METADATA.DIM", tmp_path):
        _, log = told(capsys, "rpc-info", name, code=2)
        assert "a DIMAP product of SPOT 5, level 1A, which names no RPC file" in log


def test_a_folder_without_rpcs_says_so(capsys, tmp_path: Path) -> None:
    (tmp_path / "readme.txt").write_text("nothing")
    _, log = told(capsys, "rpc-info", tmp_path, code=2)
    assert "contains no image with an RPC" in log


def test_a_list_names_images_beside_it(capsys, scene: Path) -> None:
    (scene / "list.txt").write_text("# both\nimage_1.tif\nimage_2.tif\n")
    report, _ = info(capsys, Path(f"@{scene / 'list.txt'}"))
    assert list(report["images"]) == ["image_1", "image_2"]


def test_one_image_is_refined_with_its_own_rows_of_a_blocks_points(capsys, scene: Path, tmp_path: Path) -> None:
    report, _ = told(capsys, "refine-rpc", scene / "image_1.tif", "--gcps", scene / "ground_points.csv",
                     "--image-points", scene / "image_points.csv", "--output-dir", tmp_path,
                     "--write", "none")  # fmt: skip
    assert list(report["images"]) == ["image_1"]
    assert any("not in the block are not used (image_2)" in text for text in report["warnings"])


def test_a_misspelt_image_of_a_point_file_is_still_an_error(capsys, scene: Path, tmp_path: Path) -> None:
    (tmp_path / "points.csv").write_text((scene / "image_points.csv").read_text().replace("image_2", "image_3"))
    _, log = told(capsys, "adjust", scene / "image_1.tif", scene / "image_2.tif", "--gcps", scene / "ground_points.csv",
                  "--image-points", tmp_path / "points.csv", "--output-dir", tmp_path / "out", code=2)  # fmt: skip
    assert "image_3" in log


@pytest.mark.parametrize(
    ("crs", "resolution", "words"), [("EPSG:4326", "0.7", "degree"), ("EPSG:2926", "1e-5", "foot")]
)
def test_a_resolution_in_another_unit_is_refused_by_name(
    capsys, scene: Path, tmp_path: Path, crs: str, resolution: str, words: str
) -> None:
    _, log = told(capsys, "orthorectify", scene / "image_1.tif", "--dem", scene / "dem.tif", "--crs", crs,
                  "--resolution", resolution, "--output-dir", tmp_path, code=2)  # fmt: skip
    assert words in log
    assert "--resolution" in log
    assert not list(tmp_path.glob("*.tif"))
