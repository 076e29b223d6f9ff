"""Pictures of the reports: block with GCPs and without, orthoimages, registration; on a desk, a phone and paper.

``python docs/make_report_pictures.py [FOLDER]`` runs the chain on a simulated block and, where ``HRSI_TEST_DATA`` names
the folder of the real blocks, on the Pleiades triplet. It writes ``NAME_desk.png`` (the first screens),
``NAME_phone.png``, ``NAME_whole.png`` (the whole page), ``NAME.pdf`` and ``NAME_print.png`` (its first pages side by
side) into FOLDER, by default ``build/pictures``. Those that the documentation shows go into ``docs/pictures`` with 256
colours: simulated ones only.
"""

from __future__ import annotations

import importlib.util
import os
import re
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from osgeo import gdal

from hrsi.processing_algorithms import run

REPOSITORY = Path(__file__).resolve().parents[1]
DESK_PX, PHONE_PX = (1280, 1700), (390, 1700)
SHEET, DPI = (4, 2), 60  # pages beside and above one another on a picture of the print
#: What the documentation shows.
SHOWN = {
    "gcps_print.png": "report_print.png", "registration_desk.png": "report_registration.png",
}  # fmt: skip


def simulate_chain(work: Path) -> dict[str, Path]:
    """Run the chain on three simulated images, with GCPs and without; return the pages by name."""
    block = work / "block"
    run("simulate", output_dir=str(block), size=900, images=3, gcps=10, checks=20, ties=150, seed=6)
    images = [str(block / f"image_{number}.tif") for number in (1, 2, 3)]
    cover = {
        "title": "Luberon, stereo triplet",
        "client": "Département des Bouches-du-Rhône",
        "place": "Aix-en-Provence",
    }
    common = {"images": images, "height_datum": "ellipsoidal"}
    run("tie-points", images=images, output_dir=str(work / "ties"))
    run(
        "triangulate", **common, **cover, gcps=str(block / "ground_points.csv"), tie_points=str(work / "ties"),
        image_points=str(block / "image_points.csv"), output_dir=str(work / "gcps"),
    )  # fmt: skip
    run("triangulate", **common, tie_points=str(work / "ties"), output_dir=str(work / "free"))
    pages = {name: work / name / "report.html" for name in ("gcps", "free")}
    return pages | make_orthoimages(work, images, work / "gcps", block / "dem.tif")


def chain_of_triplet(folder: Path, work: Path) -> dict[str, Path]:
    """Run the chain on the real triplet, without GCPs; return the pages by name."""
    images = sorted(str(path) for path in folder.glob("img_0?.tif"))
    run("triangulate", images=images, output_dir=str(work / "free"))
    pages = make_orthoimages(work, images, work / "free", folder / "s2p_reference_dsm.tif", fill_gaps=20)
    return {"triplet_free": work / "free" / "report.html"} | {f"triplet_{name}": page for name, page in pages.items()}


def make_orthoimages(work: Path, images: list[str], refined: Path, dem: Path, **more: Any) -> dict[str, Path]:
    """Make orthoimages with the delivered and with the refined RPCs and compare them; return the pages by name."""
    for state, paths in (("before", images), ("after", [str(refined / Path(path).name) for path in images])):
        run(
            "orthorectify", images=paths, dem=str(dem), height_datum="ellipsoidal", extent="overlap",
            output_dir=str(work / state), **more,
        )  # fmt: skip
    orthos = sorted(str(path) for path in (work / "after").glob("*_ortho.tif"))
    run("ortho-check", images=orthos, before=str(work / "before"), output_dir=str(work / "registration"))
    return {"orthoimages": work / "after" / "report.html", "registration": work / "registration" / "report.html"}


def photograph(pages: dict[str, Path], work: Path, pictures: Path) -> None:
    """Have Chromium show and print each page."""
    spec = importlib.util.spec_from_file_location("browser", REPOSITORY / "tests" / "browser.py")
    driver = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(driver)
    if driver.chromium_program() is None:
        sys.exit("Chromium is not installed: apt-get install chromium")
    with driver.Browser(work / "web") as browser:
        for name, page in pages.items():
            browser.open(page, *DESK_PX)
            browser.picture(pictures / f"{name}_desk.png", whole=False)
            browser.picture(pictures / f"{name}_whole.png")
            browser.print(pictures / f"{name}.pdf")
            browser.open(page, *PHONE_PX, phone=True)
            browser.picture(pictures / f"{name}_phone.png", whole=False)
            lay_out_print(pictures / f"{name}.pdf", pictures / f"{name}_print.png")
            print(f"{name}: {page.stat().st_size / 1e6:.1f} MB")


def lay_out_print(printed: Path, picture: Path) -> None:
    """Lay the first pages of a PDF beside one another, where this GDAL reads PDF."""
    count = min(len(re.findall(rb"/Type\s*/Page\b", printed.read_bytes())), SHEET[0] * SHEET[1])
    if gdal.GetDriverByName("PDF") is None:
        return
    pages = [
        gdal.OpenEx(f"PDF:{number + 1}:{printed}", open_options=[f"DPI={DPI}"]).ReadAsArray()[:3]
        for number in range(count)
    ]
    _, height, width = pages[0].shape
    sheet = np.full((3, SHEET[1] * (height + 8), SHEET[0] * (width + 8)), 120, dtype=np.uint8)
    for number, page in enumerate(pages):
        y, x = number // SHEET[0] * (height + 8), number % SHEET[0] * (width + 8)
        sheet[:, y : y + height, x : x + width] = page
    memory = gdal.GetDriverByName("MEM").Create("", sheet.shape[2], sheet.shape[1], 3, gdal.GDT_Byte)
    memory.WriteArray(sheet)
    gdal.GetDriverByName("PNG").CreateCopy(str(picture), memory)
    Path(f"{picture}.aux.xml").unlink(missing_ok=True)


def reduce_colours(source: Path, target: Path) -> None:
    """Write a picture with 256 colours of its own, a third of the bytes."""
    picture = gdal.Open(str(source))
    bands, table = [picture.GetRasterBand(number) for number in (1, 2, 3)], gdal.ColorTable()
    gdal.ComputeMedianCutPCT(*bands, 256, table)
    memory = gdal.GetDriverByName("MEM").Create("", picture.RasterXSize, picture.RasterYSize, 1, gdal.GDT_Byte)
    memory.GetRasterBand(1).SetColorTable(table)
    gdal.DitherRGB2PCT(*bands, memory.GetRasterBand(1), table)
    gdal.GetDriverByName("PNG").CreateCopy(str(target), memory)
    Path(f"{target}.aux.xml").unlink(missing_ok=True)


if __name__ == "__main__":
    made = Path(sys.argv[1]) if len(sys.argv) > 1 else REPOSITORY / "build" / "pictures"
    made.mkdir(parents=True, exist_ok=True)
    real = Path(os.environ.get("HRSI_TEST_DATA", "")) / "real" / "s2p_triplet_phr"
    with tempfile.TemporaryDirectory(prefix="hrsi-") as temporary:
        found = simulate_chain(Path(temporary) / "simulated")
        if real.is_dir():
            found |= chain_of_triplet(real, Path(temporary) / "triplet")
        photograph(found, Path(temporary), made)
    if len(sys.argv) == 1:
        for file, shown in SHOWN.items():
            reduce_colours(made / file, REPOSITORY / "docs" / "pictures" / shown)
