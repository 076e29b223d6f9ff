"""Mutated RPC files and images into the readers: every call ends soon, with an RPC or an `InputError`.

``python tests/fuzz_rpc_files.py --runs 100000 --seed 1`` runs by itself; a process of its own, because a crash of GDAL
would end the tests. Seeds are files written here and, where ``--data`` names them, the real ones.
"""

from __future__ import annotations

import argparse
import faulthandler
import random
import signal
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
from rpc_samples import sample_rpc, write_image

from hrsi.hrsi_engine.foundation.errors import InputError
from hrsi.hrsi_engine.io.rasters import open_image
from hrsi.hrsi_engine.io.rpc_files import write_rpb, write_rpc_text, write_vrt

LONGEST_SECONDS = 20
LARGEST_SEED = 700_000
SUFFIXES = {".tif", ".ntf", ".nitf", ".xml", ".geom", ".rpb", ".json", ".txt"}
TOKENS = [
    b"nan", b"inf", b"-1e999", b"0", b"<", b"</", b"&x;", b"<!DOCTYPE a [", b"(", b")", b"=", b":", b"\0", b"\xff\xfe",
    b" " * 5000, b"\n" * 5000, b"9" * 5000, b"[" * 5000, b"a=" * 3000, b"LINE_OFF: ", b"\xd9\xa3",
]  # fmt: skip


def mutated(content: bytes, rng: random.Random) -> bytes:
    """Return the content with one to eight faults: flipped, cut, repeated, moved or foreign bytes."""
    data = bytearray(content)
    for _ in range(rng.randint(1, 8)):
        place = rng.randrange(len(data) + 1)
        if rng.random() < 0.5:  # most faults belong into the head, where the structure is
            place = min(place, rng.randrange(1, 4000))
        length = rng.choice((1, 1, 2, 4, 8, 40, 400))
        kind = rng.randrange(6)
        if kind == 0:
            data[place : place + length] = rng.randbytes(length)
        elif kind == 1:
            del data[place : place + length]
        elif kind == 2:
            data[place:place] = data[place : place + length] * rng.choice((1, 3))
        elif kind == 3:
            data[place:place] = rng.choice(TOKENS)
        elif kind == 4:
            del data[place:]
        else:
            data[place : place + 1] = bytes([data[place] ^ (1 << rng.randrange(8))]) if place < len(data) else b""
    return bytes(data)


def seeds(folder: Path, data: Path | None) -> dict[str, bytes]:
    """Return file name -> content of undamaged files."""
    rpc = sample_rpc(1, err_bias=2.0)
    write_rpc_text(str(folder / "a_RPC.TXT"), rpc)
    write_rpb(str(folder / "b.RPB"), rpc)
    write_image(folder / "c.tif", rpc, size=(40, 30))
    write_image(folder / "d.tif", rpc, ("BIGTIFF=YES", "TILED=YES", "COMPRESS=DEFLATE"), size=(40, 30))
    write_vrt(str(folder / "c.tif"), str(folder / "e.vrt"), rpc)
    found = {path.name: path.read_bytes() for path in folder.iterdir()}
    for path in sorted(data.rglob("*")) if data else []:
        if path.suffix.lower() in SUFFIXES and path.stat().st_size < LARGEST_SEED:
            found[path.name] = path.read_bytes()
    return found


def read_mutated(path: Path) -> str:
    """Return how reading ended: ``rpc`` or ``InputError``; anything else is raised."""
    signal.alarm(LONGEST_SECONDS)
    try:
        image = open_image(str(path))
        if image.raster is not None:
            image.raster.read(0, 0, 16, 16)
        return "rpc"
    except InputError as error:
        if "\n" in str(error) or path.name not in str(error):
            raise RuntimeError(f"not one line that names the file: {error}") from error
        return "InputError"
    finally:
        signal.alarm(0)


def main(arguments: list[str] | None = None) -> int:
    """Run the fuzzing; print how the calls ended. A failing input is left behind and named."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=20_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--data", type=Path)
    options = parser.parse_args(arguments)
    faulthandler.enable()
    rng, counts = random.Random(options.seed), {"rpc": 0, "InputError": 0}
    folder = Path(tempfile.mkdtemp(prefix="hrsi-fuzz-"))
    inputs = seeds(folder, options.data)
    for path in folder.iterdir():
        if path.name != "c.tif":  # the VRT points to it
            path.unlink()
    for run in range(options.runs):
        name = rng.choice(sorted(inputs))
        path = folder / f"fuzz_{name}"
        path.write_bytes(mutated(inputs[name], rng))
        print(f"run {run}: {path}", file=sys.stderr) if options.runs == 1 else None
        counts[read_mutated(path)] += 1
        path.unlink()
    print(f"{options.runs} mutated files of {len(inputs)} kinds: {counts['rpc']} read, {counts['InputError']} refused")
    (folder / "c.tif").unlink()
    folder.rmdir()
    return 0


if __name__ == "__main__":
    sys.exit(main())
