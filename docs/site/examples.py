"""An example for each algorithm: a command that runs on data of the repository, and what it prints.

``python docs/site/examples.py`` runs them all in a new folder and writes what they print into ``docs/examples``; the
pages of the algorithms show both. They are run in this order: later ones use results of earlier ones.
"""

from __future__ import annotations

import contextlib
import io
import os
import re
import shlex
import tempfile
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PRINTED = ROOT / "docs" / "examples"
MOST_LINES = 24  # of what is shown
HOBART = "examples/hobart/hobart"
POINTS = f"--gcps {HOBART}_ground_points.csv --image-points {HOBART}_image_points.csv --height-datum ellipsoidal"
GCPS = "--gcp-ids H003,H022,H024,H035,H048,H058,H077,H098,H103,H105"
BLOCK = "block/image_1.tif block/image_2.tif block/image_3.tif"
BLOCK_POINTS = "--gcps block/ground_points.csv --image-points block/image_points.csv --height-datum ellipsoidal"
COMMANDS = {
    "simulate": "--images 3 --along=-12,0,12 --size 320 --gcps 6 --checks 12 --ties 0 --relief 60 --output-dir block",
    "rpc-info": f"{HOBART}_ikonos_1_RPC.TXT {HOBART}_ikonos_3_RPC.TXT",
    "refine-rpc": f"{HOBART}_ikonos_1_RPC.TXT {POINTS} {GCPS} --compare --output-dir refined",
    "adjust": f"{HOBART}_ikonos_1_RPC.TXT {HOBART}_ikonos_3_RPC.TXT {POINTS} {GCPS} --output-dir adjusted",
    "project": f"{HOBART}_ikonos_1_RPC.TXT --points {HOBART}_ground_points.csv --height-datum ellipsoidal",
    "localize": f"{HOBART}_ikonos_1_RPC.TXT {HOBART}_ikonos_2_RPC.TXT {HOBART}_ikonos_3_RPC.TXT "
    f"--points {HOBART}_image_points.csv --height 50",
    "fit-rpc": "--points 'refined/block.gpkg|layername=image_points' --id hobart --output-dir fitted",
    "measure-targets": f"--edges {HOBART}_roundabout_edges.csv --output-dir targets",
    "interest-points": "block/image_1.tif --output-dir interest",
    "match": "block/image_1.tif block/image_2.tif --output-dir matched",
    "tie-points": f"{BLOCK} --output-dir ties",
    "triangulate": f"{BLOCK} {BLOCK_POINTS} --dem block/dem.tif --output-dir triangulated",
    "register": "block/image_1.tif block/image_2.tif --image-points 'triangulated/block.gpkg|layername=image_points' "
    "--output-dir registered",
    "evaluate": f"{BLOCK} --rpcs refined=triangulated --tracks none {BLOCK_POINTS} --output-dir compared",
    "surface-model": "triangulated --output-dir surface",
    "hand-over": "triangulated --to cars --output-dir handed",
    "write-rpc": "block/image_1.tif --rpc triangulated/image_1.tif --write vrt --output-dir written",
    "crop": "block/image_1.tif --window 40,60,100,80 --output-dir cropped",
    "strip": "cropped/image_1_crop.tif block/image_1.tif --output-dir joined",
    "orthorectify": f"{BLOCK.replace('block', 'triangulated')} --dem block/dem.tif --dem-datum ellipsoidal "
    "--output-dir ortho",
    "ortho-check": "ortho/image_1_ortho.tif ortho/image_2_ortho.tif ortho/image_3_ortho.tif --output-dir check",
    "init": "block --output block.toml",
    "run": "examples/hobart/project.toml --output-dir project",
    "gcps-from-reference": "block/image_1.tif --reference ortho/image_2_ortho.tif --dem block/dem.tif "
    "--dem-datum ellipsoidal --output-dir found",
}
#: Pictures that say more than the lines.
PICTURES = {
    "triangulate": ("report.png", "The report of a block"),
    "adjust": ("qgis_residuals.png", "The residual layer in QGIS"),
}


TICKS = re.compile(r"[0-9.]+( - done\.)?")  #: of progress


def run_examples() -> Iterator[tuple[str, int, str]]:
    """Run the commands in the current folder; yield each algorithm, its exit code and what it printed."""
    from hrsi.processing_algorithms.command_line import cli

    for name, words in COMMANDS.items():
        out = io.StringIO()
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(io.StringIO()) as told:
            code = cli.main([name, *shlex.split(words)])
        lines = [line for line in told.getvalue().splitlines() if line and not TICKS.fullmatch(line)]
        yield name, code, "\n".join([*lines, *out.getvalue().splitlines()])


def example_of(name: str) -> Iterator[str]:
    """Yield the paragraphs of an algorithm's example, in Markdown."""
    words = shlex.join(["hrsi", name]) + " " + COMMANDS[name]
    shown = (PRINTED / f"{name}.txt").read_text(encoding="utf-8").splitlines()
    yield "## Example"
    yield f"```sh\n{folded(words)}\n```"
    yield "\n".join(["prints", "", "```text", *shown, "```"])
    if name in PICTURES:
        file, title = PICTURES[name]
        yield f"![{title}](../pictures/{file})"


def folded(command: str, width: int = 100) -> str:
    """Return a command on lines that a page shows whole."""
    lines = [""]
    for word in command.split(" "):
        if lines[-1] and len(lines[-1]) + len(word) + 3 > width:
            lines[-1] += " \\"
            lines.append(" ")
        lines[-1] += f" {word}" if lines[-1] else word
    return "\n".join(lines)


def write_examples() -> None:
    """Run the examples and keep what they print."""
    PRINTED.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        os.symlink(ROOT / "examples", Path(folder) / "examples")
        with contextlib.chdir(folder):
            for name, code, printed in run_examples():
                print(f"{name}: {code}" + (f"\n{printed}" if code else ""))
                if code == 0:
                    lines = printed.rstrip().splitlines()
                    shown = [*lines[:MOST_LINES], *(["…"] if len(lines) > MOST_LINES else [])]
                    (PRINTED / f"{name}.txt").write_text("\n".join(shown) + "\n", encoding="utf-8")


if __name__ == "__main__":
    write_examples()
