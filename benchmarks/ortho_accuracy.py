"""How well orthoimages of real images fit one another, before and after triangulation: ``ortho_accuracy.py [NAME …]``.

Names: ``s2p``, ``kahramanmaras``, ``ventoux``; all by default. Misregistration is that of `ortho-check`
(median of the lengths of the shifts in windows matched both before and after).

* s2p: three Pleiades crops and the DSM that s2p made of them (gaps up to 12 cells interpolated).
* kahramanmaras: four Pleiades crops of two dates without any DEM: constant height, and the terrain through the tie
  points, the usual ones and dense ones, intersected with the original RPCs for "before" (model none) and with the
  refined ones for "after".
* ventoux: a Pleiades pair of 20 degrees convergence and SRTM of 90 m with EGM96; with its heights as control too.
"""

import sys
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from hrsi.benchmarks import pages
from hrsi.processing_algorithms import run

DATA = pages.DATA / "real"
Options = Mapping[str, Any]


def triangulated(images: list[str], folder: Path, **options: Any) -> list[str]:
    """Triangulate; return the refined images."""
    run("triangulate", images=images, output_dir=str(folder), report=False, **options)
    return [str(folder / Path(image).name) for image in images]


def points_of(folder: Path) -> dict[str, Any]:
    """Return the option that makes terrain of a triangulation's points."""
    return {"terrain_points": f"{folder / 'block.gpkg'}|layername=ground_points"}


def compared(
    title: str, before: list[str], after: list[str], folder: Path, first: Options, second: Options, **check: Any
) -> None:
    """Make orthoimages of both sets and print what `ortho-check` finds."""
    same: dict[str, Any] = {"extent": "union", "resolution": 0.5, "report": False, "overwrite": True}
    for name, images, terrain in (("before", before, first), ("after", after, second)):
        run("orthorectify", images=images, output_dir=str(folder / name), **(same | dict(terrain)))
    orthos = [str(folder / "after" / f"{Path(image).stem}_ortho.tif") for image in after]
    report = run("ortho-check", images=orthos, before=str(folder / "before"), output_dir=str(folder / "check"),
                 overwrite=True, report=False, **check)  # fmt: skip
    show(title, report)


def show(title: str, report: Options) -> None:
    """Print a table of misregistration."""
    print(f"\n{title}\n  {'':44}{'windows':>8}{'before: median':>16}{'90 %':>8}{'after: median':>16}{'90 %':>8}"
          f"{'after: dx':>12}{'dy':>8}")  # fmt: skip
    for entry in [*report["pairs"], report["all"] | {"first": "all", "second": "windows"}]:
        before, after = entry.get("before", {}), entry["after"]
        cells = [before.get("median_px"), before.get("p90_px"), after["median_px"], after["p90_px"]]
        cells += [after["median_dx_px"], after["median_dy_px"]]
        text = "".join(
            f"{'-' if value is None else format(value, '.3f'):>{width}}"
            for value, width in zip(cells, (16, 8, 16, 8, 12, 8), strict=True)
        )
        print(f"  {entry['first'] + ' - ' + entry['second']:<44}{after['windows']:>8}{text}", flush=True)


def s2p(folder: Path) -> None:
    """Print the triplet's table."""
    images = [str(DATA / "s2p_triplet_phr" / f"img_0{k}.tif") for k in (1, 2, 3)]
    dem = {"dem": str(DATA / "s2p_triplet_phr" / "s2p_reference_dsm.tif"), "height_datum": "ellipsoidal",
           "fill_gaps": 12}  # fmt: skip
    compared("s2p triplet, DSM", images, triangulated(images, folder / "refined"), folder, dem, dem)
    control = {"dem": dem["dem"], "height_datum": "ellipsoidal", "sigma_dem": 1.0}
    held = triangulated(images, folder / "held", **control)
    compared("s2p triplet, DSM, tie points held to it (1 m)", images, held, folder, dem, dem)


def kahramanmaras(folder: Path) -> None:
    """Print the tables of the block of two dates, with the usual tie points and with dense ones."""
    images = [str(path) for path in sorted((DATA / "kahramanmaras_phr4").glob("p*.tif"))]
    check = {"search": 12, "window": 32}
    for name, dense in (("tie points", False), ("dense tie points", True)):
        here = folder / name.replace(" ", "_")
        run("tie-points", images=images, output_dir=str(here / "ties"), dense=dense)
        ties = {"tie_points": str(here / "ties" / "block.gpkg")}
        refined = triangulated(images, here / "refined", **ties)
        triangulated(images, here / "original", model="none", write="none", **ties)
        if not dense:
            flat = {"height": 704.0}
            compared("Kahramanmaras, constant height of 704 m", images, refined, here, flat, flat, **check)
        terrain = points_of(here / "original"), points_of(here / "refined")
        compared(f"Kahramanmaras, terrain through the {name}", images, refined, here, *terrain, **check)
        compared("  the same, windows of 48 px", images, refined, here, *terrain, search=12)


def ventoux(folder: Path) -> None:
    """Print the tables of the pair of 20 degrees."""
    images = [str(DATA / "ventoux_phr_pair" / f"{side}_image.tif") for side in ("left", "right")]
    dem = {"dem": str(DATA / "ventoux_phr_pair" / "dem" / "N44E005.hgt"),
           "height_datum": str(DATA / "ventoux_phr_pair" / "dem" / "egm96_15.gtx")}  # fmt: skip
    refined = triangulated(images, folder / "refined", **dem)
    triangulated(images, folder / "original", model="none", write="none", **dem)
    terrain = points_of(folder / "original"), points_of(folder / "refined")
    compared("Ventoux, SRTM and EGM96", images, refined, folder, dem, dem, search=32)
    held = triangulated(images, folder / "held", sigma_dem=5.0, **dem)
    compared("Ventoux, SRTM and EGM96, tie points held to it (5 m)", images, held, folder, dem, dem, search=32)
    compared("Ventoux, terrain through the tie points", images, refined, folder, *terrain, search=32)


TABLES: dict[str, Callable[[Path], None]] = {"s2p": s2p, "kahramanmaras": kahramanmaras, "ventoux": ventoux}


def main() -> None:
    for name in sys.argv[1:] or TABLES:
        with tempfile.TemporaryDirectory() as folder:
            TABLES[name](Path(folder))


if __name__ == "__main__":
    main()
