"""How well RPCs fit real blocks before and after HRSI, by tracks that took no part: `evaluate_rpcs.py [--docs]`.

The tracks are those of OpenCV's SIFT, found without any RPC. ``--docs`` writes docs/protocols/evaluation.md. The
data lie in HRSI_TEST_DATA (see CONTRIBUTING.md).
"""

import sys
import tempfile
from pathlib import Path
from typing import Any

import real_blocks

from hrsi.benchmarks.pages import DATA, DOCS, put_between
from hrsi.hrsi_engine import open_image
from hrsi.hrsi_engine.io.point_files.csv_text import write_measurements
from hrsi.processing_algorithms import run

PAGE = DOCS / "protocols/evaluation.md"
MODELS = ("shift", "affine")
#: Folders of real data, and their images.
SAMPLES = {
    "triplet": ("s2p_triplet_phr", ("img_01", "img_02", "img_03")),
    "Kahramanmaras": (
        "kahramanmaras_phr4", ("pre_event_img1", "pre_event_img2", "post_event_img1", "post_event_img2"),
    ),
    "Ventoux": ("ventoux_phr_pair", ("left_image", "right_image")),
}  # fmt: skip
HEAD = (
    "| block | wrong matches | RPCs | predicted RMSE px | median px | fit px | two views px | three px | four px "
    "| medians of pairs px | scatter px |\n|---|---|---|---|---|---|---|---|---|---|---|"
)


def evaluated(name: str, folder: Path, reject: float) -> dict[str, Any]:
    """Return the report on a sample's own RPCs and those that HRSI makes of them, on tracks of SIFT."""
    place, files = SAMPLES[name]
    images = [str(DATA / "real" / place / f"{file}.tif") for file in files]
    tracks = folder / "sift.csv"
    if not tracks.exists():
        write_measurements(str(tracks), real_blocks.sift_tracks([open_image(path) for path in images])[0])
        for model in MODELS:
            run("triangulate", images=images, model=model, write="sidecar", report=False,
                output_dir=str(folder / model), height_datum="ellipsoidal")  # fmt: skip
    return run("evaluate", images=images, tracks=str(tracks), reject=reject, report=False, overwrite=True,
               rpcs={f"HRSI, {model}".replace(", ", "-"): folder / model for model in MODELS},
               output_dir=str(folder / "evaluation"))  # fmt: skip


def rows(name: str, reject: float, report: dict[str, Any]) -> list[str]:
    """Return the lines of a sample."""
    kept = "kept" if not reject else f"{report['tracks']['wrong']} left out"
    lines = []
    for set_name, entry in report["sets"].items():
        fits = [_number(value) for value in (entry["fit_rmse_px"], *map(entry["fit_by_views"].get, "234"))]
        pairs = " ".join(f"{abs(pair['bias_px']):.2f}" for pair in entry["pairs"])
        lines.append(
            f"| {name} | {kept} | {set_name} | {_number(entry['predicted_rmse_px'])} "
            f"| {_number(entry['predicted_median_px'])} | {' | '.join(fits)} | {pairs} "
            f"| {_number(entry['scatter_px'])} |"
        )
    return lines


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.3f}"


def main() -> None:
    """Print the table; write it into the page where asked."""
    lines = [HEAD]
    for name in SAMPLES:
        with tempfile.TemporaryDirectory() as folder:
            for reject in (0.0, 6.0):
                lines += rows(name, reject, evaluated(name, Path(folder), reject))
    print("\n".join(lines))
    if "--docs" in sys.argv[1:]:
        put_between(PAGE, "evaluation", "\n".join(lines))


if __name__ == "__main__":
    main()
