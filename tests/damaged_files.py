"""Files damaged on purpose, and what HRSI's readers make of them; each reading in a process of its own with limits.

`sound_files` makes sound files of every kind that is read, with the simulator and the writers of the engine; `DAMAGES`
are the ways to damage one; `READERS` read them as the algorithms do. `examine` has a reader read a file in a forked
process and tells how that ended. The process that forks must have no other threads: one for BLAS.
"""

import itertools
import json
import os
import random
import re
import resource
import select
import shutil
import signal
import struct
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from gdal_files import write_layer, write_raster
from osgeo import gdal
from rpc_samples import sample_rpc, write_image

from hrsi.hrsi_engine.foundation.errors import HrsiError
from hrsi.hrsi_engine.io.catalogue.deliveries import resolve_images
from hrsi.hrsi_engine.io.geopackage.layers import Layer, write_geopackage
from hrsi.hrsi_engine.io.output_dir import names_of_last_run
from hrsi.hrsi_engine.io.point_files import measurements_of, read_points
from hrsi.hrsi_engine.io.rasters.dems import open_dem, open_geoid, read_geoid_heights
from hrsi.hrsi_engine.io.rasters.images import GdalRaster, open_image
from hrsi.hrsi_engine.io.rasters.ortho_rasters import open_reference
from hrsi.hrsi_engine.io.rpc_files import write_rpc_text, write_vrt
from hrsi.hrsi_engine.io.safety.array_files import PartStore
from hrsi.hrsi_engine.io.safety.transactions import recover_folders
from hrsi.hrsi_engine.measurement.block_matching.overview import choose_overview_step
from hrsi.hrsi_engine.surface.dem import intersect_surface, surface_heights
from hrsi.processing_algorithms import run
from hrsi.processing_algorithms.command_line.cli import main as command_line
from hrsi.processing_algorithms.point_session.files import open_block

MOST_SECONDS, MOST_BYTES = 10.0, 2**30  # what one reading may take: processor time, and memory with the interpreter
MOST_WAITING_S = 60.0
LARGEST_REAL = 700_000  # bytes of a real file that is worth damaging
PLACE = (7.05, 45.05)  # of what the simulator makes

# ---- ways to damage a file -----------------------------------------------------------------------------------------

Damage = Callable[[bytes, random.Random], bytes]
_NUMBER = re.compile(rb"[+-]?\d+\.?\d*([eE][+-]?\d+)?")
_TEXT_NUMBERS = (
    b"0",
    b"-1",
    b"1e308",
    b"-1e-308",
    b"nan",
    b"inf",
    b"9" * 400,
    b"1e9",
    b"123456789012345678",
    b"",
    b"\xd9\xa3",
)
_BINARY_NUMBERS = (0, 1, 0x7F, 0x7FFF, 0x7FFFFFFF, 0x7FFFFFFFFFFFFFFF, 2**64 - 1, 2**16, 2**20, 2**31)
_FOREIGN = (
    b"nan", b"-1e999", b"<", b"</", b"&x;", b"<!DOCTYPE a [", b"(", b")", b"=", b":", b"\0", b"\xff\xfe", b" " * 5000,
    b"\n" * 5000, b"9" * 5000, b"[" * 5000, b"a=" * 3000, b"LINE_OFF: ", b"\xd9\xa3", b"\"", b",", b";" * 3000,
    b"PK\x03\x04",
)  # fmt: skip


def _place(data: bytes, rng: random.Random) -> int:
    """Return a place in a file: every second time in the head, where the structure is."""
    last = len(data) if rng.random() < 0.5 else min(len(data), rng.choice((16, 128, 1000, 4000)))
    return rng.randrange(max(last, 1))


def _piece(data: bytes, rng: random.Random) -> slice:
    first = _place(data, rng)
    return slice(first, first + rng.choice((1, 1, 2, 4, 8, 40, 400, 4096)))


def _flip_bits(data: bytes, rng: random.Random) -> bytes:
    changed = bytearray(data)
    for _ in range(rng.randint(1, 16)):
        changed[_place(data, rng)] ^= 1 << rng.randrange(8)
    return bytes(changed)


def _put_other_bytes(data: bytes, rng: random.Random) -> bytes:
    piece = _piece(data, rng)
    old = data[piece]
    return data[: piece.start] + rng.randbytes(len(old)) + data[piece.start + len(old) :]


def _put_other_numbers(data: bytes, rng: random.Random) -> bytes:
    for _ in range(rng.randint(1, 4)):
        found = list(_NUMBER.finditer(data[:200_000])) if b"\0" not in data[:2000] else []
        if found:
            number = rng.choice(found)
            data = data[: number.start()] + rng.choice(_TEXT_NUMBERS) + data[number.end() :]
        else:
            size, order = rng.choice((1, 2, 4, 8)), rng.choice(("little", "big"))
            first = _place(data, rng) // rng.choice((1, 2, size)) * 1
            value = (rng.choice(_BINARY_NUMBERS) % 256**size).to_bytes(size, order)  # type: ignore[arg-type]
            if rng.random() < 0.2:
                size, value = 8, struct.pack("<d", rng.choice((np.nan, np.inf, 1e308, -1e30, 1e-300, -32768.0)))
            data = data[:first] + value + data[first + size :]
    return data


def _cut(data: bytes, rng: random.Random) -> bytes:
    return data[: _place(data, rng)]


def _remove(data: bytes, rng: random.Random) -> bytes:
    piece = _piece(data, rng)
    return data[: piece.start] + data[piece.stop :]


def _repeat(data: bytes, rng: random.Random) -> bytes:
    piece = _piece(data, rng)
    return data[: piece.start] + data[piece] * rng.choice((2, 3, 100)) + data[piece.stop :]


def _put_foreign(data: bytes, rng: random.Random) -> bytes:
    for _ in range(rng.randint(1, 4)):
        first = _place(data, rng)
        data = data[:first] + rng.choice(_FOREIGN) + data[first:]
    return data


def _blank(data: bytes, rng: random.Random) -> bytes:
    first, length = _place(data, rng), rng.choice((16, 512, 4096, 65536))
    filling = rng.choice((b"\0", b"\xff", b" "))
    return data[:first] + filling * len(data[first : first + length]) + data[first + length :]


def _exchange(data: bytes, rng: random.Random) -> bytes:
    size = rng.choice((8, 64, 512, 4096))
    first, second = sorted((_place(data, rng), _place(data, rng)))
    second = max(second, first + size)
    return b"".join(
        (data[:first], data[second : second + size], data[first + size : second], data[first : first + size],
         data[second + size :])
    )  # fmt: skip


#: Ways to damage a file's content, by what the tables call them.
DAMAGES: dict[str, Damage] = {
    "bits": _flip_bits,
    "bytes": _put_other_bytes,
    "numbers": _put_other_numbers,
    "cut": _cut,
    "removed": _remove,
    "repeated": _repeat,
    "foreign": _put_foreign,
    "blank": _blank,
    "exchanged": _exchange,
}


_MAIN = {".shx": (".shp",), ".dbf": (".shp",), ".prj": (".shp", ".asc"), ".xsd": (".gml",), ".aux.xml": ("",)}

# ---- what is read, and how -----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class SoundFile:
    """A file that is to be damaged: who reads it, its name, and the folder in which others stand that it needs.

    ``main`` is the file to be read, where the damaged one belongs to another.
    """

    reader: str
    folder: Path
    name: str

    @property
    def main(self) -> str:
        for suffix, owners in _MAIN.items():
            stem = self.name.removesuffix(suffix)
            for owner in owners if stem != self.name else ():
                if (self.folder / (stem + owner)).exists():
                    return stem + owner
        return self.name

    @property
    def content(self) -> bytes:
        return (self.folder / self.name).read_bytes()


def _read_rpc(path: Path) -> None:
    image = open_image(str(path))
    ground = image.rpc.localize(np.array([[10.0, 10.0], [200.0, 150.0]]), image.rpc.height_off).ground
    image.rpc.project(ground)
    if image.raster is not None:
        image.raster.read(0, 0, 16, 16)


def _read_image(path: Path) -> None:
    raster = GdalRaster(str(path))
    for share in (0.0, 0.4, 0.9):
        raster.read(int(share * raster.size[0]), int(share * raster.size[1]), 256, 256)
    raster.read_means(choose_overview_step(raster.size))


def _read_delivery(path: Path) -> None:
    """An archive, or the folder in which a damaged file lies, with the first pixels of the images that it holds."""
    name = path if path.name.endswith((".zip", ".tar", ".gz")) else path.parent
    for file in resolve_images([str(name)], lambda _text: None)[:3]:
        image = open_image(file)
        if image.raster is not None:
            image.raster.read(0, 0, 16, 16)


def _read_dem(path: Path) -> None:
    surface = open_dem(str(path), "ellipsoidal")
    rpc = sample_rpc()
    image = np.column_stack([np.linspace(5.0, 395.0, 20), np.linspace(295.0, 5.0, 20)])
    surface_heights(surface, rpc.localize(image, rpc.height_off).ground[:, :2])
    intersect_surface(rpc, image, surface)


def _read_geoid(path: Path) -> None:
    read_geoid_heights(np.array([[*PLACE, 0.0], [PLACE[0] + 0.002, PLACE[1], 0.0]]), open_geoid(str(path)))


def _read_points(path: Path) -> None:
    spec = f"{path}|layername=waypoints" if path.suffix == ".gpx" else measurements_of(str(path))
    flat = lambda lonlat: np.zeros(len(lonlat))  # noqa: E731
    tables = read_points(
        spec, image_ids=["image_1", "image_2"], height_datum="ellipsoidal", ground_crs="EPSG:4979", surface=flat
    )
    assert tables.ground is None or np.isfinite(tables.ground.ground).all()
    assert tables.image is None or np.isfinite(tables.image.xy).all()


def _read_gcp_layer(path: Path) -> None:
    read_points(f"{path}|layername=ground_points", height_datum="ellipsoidal")
    _read_points(path)


def _adjust(path: Path) -> None:
    """The whole command with one damaged input; where it is another file, with that in the place of a sound one."""
    images = ["image_1.tif", "image_2.tif"]
    given = {"gcps": "ground_points.csv", "image-points": "image_points.csv", "dem": "dem.tif"}
    words = [
        "adjust",
        *(str(path.parent / name) for name in images),
        "--height-datum",
        "ellipsoidal",
        "--sigma-dem",
        "5",
    ]
    for option, name in given.items():
        words += [f"--{option}", str(path.parent / name)]
    words += ["--output-dir", str(path.parent / "out"), "--overwrite", "--quiet"]
    before = {file: file.read_bytes() for file in path.parent.iterdir() if file.is_file() and file != path}
    told, aside = os.pipe()
    kept = os.dup(2)
    os.dup2(aside, 2)
    try:
        code = command_line(words)
    finally:
        sys.stderr.flush()
        os.dup2(kept, 2)
        os.close(aside)
    text = os.read(told, 60_000).decode(errors="replace") if select.select([told], [], [], 0)[0] else ""
    if code not in (0, 1, 2, 3) or "fault of HRSI" in text or "Traceback" in text:
        raise RuntimeError(f"exit code {code}: {text}")
    if any(file.read_bytes() != content for file, content in before.items()):
        raise RuntimeError("an input was changed")
    if code:
        raise Refused(text.strip().splitlines()[-1] if text.strip() else "")


class Refused(HrsiError):
    """The command line ended with an error of the input."""


#: How files are read, by what the tables call them.
READERS: dict[str, Callable[[Path], object]] = {
    "RPC": _read_rpc,
    "image": _read_image,
    "archive": _read_delivery,
    "folder": _read_delivery,
    "reference": lambda path: open_reference(str(path)).raster.read(0, 0, 64, 64),
    "DEM": _read_dem,
    "geoid": _read_geoid,
    "points": _read_points,
    "layers": _read_gcp_layer,
    "session": lambda path: open_block(str(path)),
    "cache": lambda path: PartStore(str(path.parent)).load("part"),
    "report": lambda path: names_of_last_run(str(path.parent)),
    "journal": lambda path: recover_folders([str(path.parent)]),
    "adjust": _adjust,
}
#: Readers that need no name in a refusal, because they go on without the file.
GO_ON = frozenset({"folder", "cache", "report", "journal", "adjust"})


def sound_files(folder: Path, data: Path | None = None) -> list[SoundFile]:
    """Return sound files of every kind, made in a folder; with real ones where ``data`` names their folder."""
    made = folder / "simulated"
    run("simulate", images=2, along="-12,12", size=300, gcps=6, checks=4, ties=40, relief=60.0, output_dir=str(made))
    block = folder / "block"
    run(
        "adjust", images=[str(made / "image_1.tif"), str(made / "image_2.tif")], gcps=str(made / "ground_points.csv"),
        image_points=str(made / "image_points.csv"), height_datum="ellipsoidal", write="none", output_dir=str(block),
    )  # fmt: skip
    files = [SoundFile("layers", block, "block.gpkg"), SoundFile("session", block, "block.gpkg")]
    files += [SoundFile("report", block, "report.json")]
    names = ("image_1.tif", "ground_points.csv", "image_points.csv", "dem.tif")
    files += [SoundFile("adjust", made, name) for name in names]
    for reader, make in _MAKERS.items():
        place = folder / reader
        place.mkdir()
        make(place)
        files += [SoundFile(reader, place, path.name) for path in sorted(place.iterdir())]
    for path in sorted(data.rglob("*")) if data is not None else []:
        reader = _REAL.get(path.suffix.lower())
        if reader and path.stat().st_size < LARGEST_REAL and examine(reader, path).how == "read":
            files.append(SoundFile(reader, path.parent, path.name))
    return files


_REAL = {".ntf": "RPC", ".nitf": "RPC", ".xml": "RPC", ".geom": "RPC", ".rpb": "RPC", ".json": "RPC", ".txt": "RPC",
         ".tif": "RPC", ".match": "points", ".gcp": "points"}  # fmt: skip


def _make_rpc_files(folder: Path) -> None:
    rpc = sample_rpc(1, err_bias=2.0)
    write_rpc_text(str(folder / "a_RPC.TXT"), rpc)
    write_rpc_text(str(folder / "b.RPB"), rpc, kind="rpb")
    write_image(folder / "c.tif", rpc, size=(40, 30))
    write_image(folder / "d.tif", rpc, ("BIGTIFF=YES", "TILED=YES", "COMPRESS=DEFLATE"), size=(40, 30))
    write_vrt(str(folder / "c.tif"), str(folder / "e.vrt"), rpc)


def _make_images(folder: Path) -> None:
    rpc = sample_rpc(1)
    size = (600, 500)
    write_image(folder / "strips.tif", rpc, size=size)
    write_image(folder / "tiles.tif", rpc, ("TILED=YES", "COMPRESS=LZW", "PREDICTOR=2"), size=size)
    write_image(folder / "picture.png", None, driver="PNG", size=size)
    write_image(folder / "wavelets.jp2", None, driver="JP2OpenJPEG", size=size)
    write_vrt(str(folder / "strips.tif"), str(folder / "view.vrt"), rpc)


def _make_archives(folder: Path) -> None:
    with tempfile.TemporaryDirectory() as name:
        place = Path(name) / "order" / "product"
        place.mkdir(parents=True)
        _make_delivery(place)
        for ending in ("zip", "tar", "gztar"):
            shutil.make_archive(str(folder / ending), ending, name)


def _make_delivery(folder: Path) -> None:
    """An image with its RPC in it, others with a file beside them, a product's XML and what is looked at in vain."""
    _make_rpc_files(folder)
    write_image(folder / "a.tif", None, size=(40, 30))
    write_image(folder / "browse.tif", None, size=(40, 30))
    (folder / "DIM_a.XML").write_text(
        '<?xml version="1.0"?><Dimap_Document><Metadata_Identification><METADATA_FORMAT version="2.15">DIMAP'
        "</METADATA_FORMAT></Metadata_Identification></Dimap_Document>"
    )


def _make_references(folder: Path) -> None:
    _raster(folder / "ortho.tif", np.uint8, ("TILED=YES",))


def _make_dems(folder: Path) -> None:
    _raster(folder / "float.tif", np.float32)
    _raster(folder / "whole.tif", np.int16, ("COMPRESS=DEFLATE", "TILED=YES"))
    _raster(folder / "text.asc", np.float32, driver="AAIGrid")
    _raster(folder / "egg.img", np.float32, driver="HFA")
    gdal.BuildVRT(str(folder / "mosaic.vrt"), [str(folder / "float.tif")]).FlushCache()


def _make_geoids(folder: Path) -> None:
    _raster(folder / "grid.gtx", np.float32, driver="GTX", level=50.0, relief=5.0)
    _raster(folder / "grid.tif", np.float32, level=50.0, relief=5.0)


def _raster(
    path: Path,
    kind: type,
    options: Sequence[str] = (),
    driver: str = "GTiff",
    level: float = 300.0,
    relief: float = 40.0,
) -> None:
    """Write heights (or grey values) around the place of the simulated camera."""
    rows, columns = np.mgrid[0:120, 0:160]
    values = np.clip(level + relief * np.sin(rows / 9.0) * np.cos(columns / 7.0), 0, None).astype(kind)
    corner = (PLACE[0] - 0.01, 1e-4, 0.0, PLACE[1] + 0.008, 0.0, -1e-4)
    write_raster(path, values, corner, "EPSG:4326", driver=driver, options=options)


def _make_point_files(folder: Path) -> None:
    rng = np.random.default_rng(3)
    rows = [
        (f"P{k}", "image_1", *(PLACE + rng.uniform(-0.01, 0.01, 2)), 300.0 + k, *rng.uniform(0.0, 300.0, 2))
        for k in range(60)
    ]
    lines = [f"{i},{m},{x:.8f},{y:.8f},{h},{s:.3f},{v:.3f}" for i, m, x, y, h, s, v in rows]
    header = "id,image,lon,lat,height,sample,line"
    (folder / "points.csv").write_text("\n".join([header, *lines]) + "\n")
    semicolons = "\n".join([header, *lines]).replace(",", ";").replace(".", ",") + "\n"
    (folder / "points.txt").write_bytes(semicolons.encode("utf-16"))
    georeferencer = [f"{x:.8f},{y:.8f},{s:.3f},{-v:.3f},1" for _, _, x, y, _, s, v in rows]
    (folder / "image_1.tif.points").write_text(
        "\n".join(["#CRS: EPSG:4979", "mapX,mapY,sourceX,sourceY,enable", *georeferencer])
    )
    asp = [
        f"{k} {y:.8f} {x:.8f} {h} 1 1 1 image_1.tif {s:.3f} {v:.3f} 1 1" for k, (_, _, x, y, h, s, v) in enumerate(rows)
    ]
    (folder / "points.gcp").write_text("\n".join(asp) + "\n")
    (folder / "PMUL-image_1.csv").write_text(
        "\n".join(["Pt.x,Pt.y,Id", *(f"{s:.3f},{v:.3f},{k}" for k, (*_, s, v) in enumerate(rows))])
    )
    features = [
        {"type": "Feature", "properties": {"filename": "image_1.tif", "id": i, "ji": [s, v]},
         "geometry": {"type": "Point", "coordinates": [x, y, h]}}
        for i, _, x, y, h, s, v in rows
    ]  # fmt: skip
    (folder / "orthority.geojson").write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    record = struct.Struct("<ffiifffBIIQ")
    match = b"".join(record.pack(s, v, int(s), int(v), 0.0, 1.0, 1.0, 1, 0, 0, 2) + b"\0" * 8 for *_, s, v in rows)
    (folder / "run-image_1__image_2.match").write_bytes(struct.pack("<QQ", 60, 60) + match + match)
    drivers = {"ESRI Shapefile": "points.shp", "GeoJSON": "layer.geojson", "KML": "points.kml", "GML": "points.gml",
               "GPX": "points.gpx", "FlatGeobuf": "points.fgb", "XLSX": "points.xlsx", "ODS": "points.ods",
               "SQLite": "points.sqlite", "GPKG": "points.gpkg"}  # fmt: skip
    for driver, name in drivers.items():
        _vector(folder / name, driver, rows)
    write_image(folder / "image_1.tif", None, size=(40, 30))
    image = gdal.Open(str(folder / "image_1.tif"), gdal.GA_Update)
    image.SetGCPs([gdal.GCP(x, y, h, s, v) for _, _, x, y, h, s, v in rows], "")


def _vector(path: Path, driver: str, rows: Sequence[tuple]) -> None:
    fields = dict(
        zip(("id", "image", "lon", "lat", "height", "sample", "line"), map(list, zip(*rows, strict=True)), strict=True)
    )
    gpx = {"name": fields["id"]} if driver == "GPX" else {}
    gdal.PushErrorHandler("CPLQuietErrorHandler")
    try:
        write_layer(
            path, driver, "EPSG:4326", np.array([row[2:5] for row in rows], float), gpx | fields,
            layer="waypoints" if gpx else "points", options=["GPX_USE_EXTENSIONS=YES"] if gpx else [],
        )  # fmt: skip
    finally:
        gdal.PopErrorHandler()


def _make_layers(folder: Path) -> None:
    """Many points with ids: one long text among them is what OGR's columns have no room for."""
    rng, rows = np.random.default_rng(4), 20_000
    position = np.column_stack([PLACE + rng.uniform(-0.01, 0.01, (rows, 2)), rng.uniform(200.0, 400.0, rows)])
    fields = {"id": np.char.add("P", np.arange(rows).astype(str)), "image": np.full(rows, "image_1")}
    fields |= {"sample": rng.uniform(0.0, 300.0, rows), "line": rng.uniform(0.0, 300.0, rows)}
    write_geopackage(str(folder / "points.gpkg"), [Layer("ground_points", "PointZ", 4326, position, fields)])


def _make_caches(folder: Path) -> None:
    rng = np.random.default_rng(5)
    PartStore(str(folder)).save("part", {"first": rng.uniform(0, 9, (50, 2)), "names": np.array(["a", "b"])})


def _make_journals(folder: Path) -> None:
    new, old = folder / "new.tif", folder / "old.tif"
    content = {
        "writer": "none:1:1",
        "steps": [["rename", str(new), str(old)], ["remove", str(old), ""]],
        "signposts": [],
    }
    (folder / ".hrsi-journal.json").write_text(json.dumps(content))


_MAKERS: dict[str, Callable[[Path], None]] = {
    "RPC": _make_rpc_files,
    "image": _make_images,
    "archive": _make_archives,
    "folder": _make_delivery,
    "reference": _make_references,
    "DEM": _make_dems,
    "geoid": _make_geoids,
    "points": _make_point_files,
    "layers": _make_layers,
    "cache": _make_caches,
    "journal": _make_journals,
}


# ---- one reading in a process of its own ---------------------------------------------------------------------------


class Ending(NamedTuple):
    """How a reading ended (``read``, ``refused``, ``traceback``, ``crash``, ``time``), what was said, and its cost."""

    how: str
    text: str
    seconds: float
    bytes: int


def examine(reader: str, path: Path) -> Ending:
    """Read a file in a forked process; faults of the reader are told, not raised."""
    return examine_all([(reader, path)])[0]


def examine_all(readings: Sequence[tuple[str, Path]]) -> list[Ending]:
    """Read files one after the other in a forked process, and those behind one that ended it in the next process.

    Memory is the most that the process had until then: what one of them takes counts for those behind it, too.
    """
    endings: list[Ending] = []
    while len(endings) < len(readings):
        receive, send = os.pipe()
        started = time.monotonic()
        child = os.fork()
        if not child:
            _read_and_exit(readings[len(endings) :], send)
        os.close(send)
        with os.fdopen(receive, "rb") as pipe:
            answers = [json.loads(line) for line in pipe.read().splitlines()]
        _, status, usage = os.wait4(child, 0)
        for how, said, seconds, waited, taken in answers:
            if how in ("read", "refused") and (seconds > MOST_SECONDS or waited > MOST_WAITING_S):
                how = "time"
            if how in ("read", "refused") and taken > MOST_BYTES:
                how = "memory"
            endings.append(Ending(how, said, seconds, taken))
        if os.WIFSIGNALED(status) or os.WEXITSTATUS(status):
            late = os.WIFSIGNALED(status) and os.WTERMSIG(status) in (signal.SIGALRM, signal.SIGXCPU)
            how, seconds = "time" if late else "crash", usage.ru_utime + usage.ru_stime
            endings.append(Ending(how, f"status {status} after {time.monotonic() - started:.0f} s", seconds, 0))
    return endings


def _read_and_exit(readings: Sequence[tuple[str, Path]], send: int) -> None:
    """Read in the forked process, tell the parent of each, and end without any cleaning up."""
    for number in (signal.SIGALRM, signal.SIGXCPU):
        signal.signal(number, signal.SIG_DFL)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    with open("/proc/self/statm", encoding="ascii") as file:
        most = int(file.read().split()[0]) * resource.getpagesize() + 4 * MOST_BYTES
    resource.setrlimit(resource.RLIMIT_AS, (most, most))
    silence = os.open(os.devnull, os.O_WRONLY)
    os.dup2(silence, 1)
    os.dup2(silence, 2)
    try:
        for reader, path in readings:
            signal.setitimer(signal.ITIMER_REAL, MOST_WAITING_S)
            used, began = time.process_time(), time.monotonic()
            resource.setrlimit(resource.RLIMIT_CPU, (int(used + MOST_SECONDS) + 2, resource.RLIM_INFINITY))
            how, said = _read(reader, path)
            taken = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
            cost = time.process_time() - used, time.monotonic() - began, taken
            os.write(send, json.dumps([how, said[-2000:], *cost]).encode() + b"\n")
    finally:
        os._exit(0)


def _read(reader: str, path: Path) -> tuple[str, str]:
    """Return how a reading ended in this process, and what was said."""
    try:
        READERS[reader](path)
    except HrsiError as error:
        text = str(error)
        sound = "\n" not in text and (reader in GO_ON or path.name in text or path.stem in text)
        return ("refused", text) if sound else ("traceback", f"not one line that names the file: {text}")
    except BaseException:
        return "traceback", traceback.format_exc()
    return "read", ""


class Laboratory:
    """A folder in which damaged files are put beside the sound ones that they need."""

    def __init__(self, folder: Path, files: Sequence[SoundFile]) -> None:
        self.folder, self.files = folder, files
        self._contents = {file: file.content for file in files}

    def damaged(self, file: SoundFile, kind: str, seed: int) -> bytes:
        """Return a file's content damaged in one way; the same again for the same seed."""
        return DAMAGES[kind](self._contents[file], random.Random(f"{file.reader}/{file.name}/{kind}/{seed}"))

    def examine(self, file: SoundFile, content: bytes) -> Ending:
        """Have a file with another content read, beside copies or links of what stands around it."""
        return self.examine_all([(file, content)])[0]

    def examine_all(self, damaged: Sequence[tuple[SoundFile, bytes]]) -> list[Ending]:
        """Have files with other contents read in one process, each in a folder of its own."""
        work = self.folder / "work"
        readings = []
        try:
            for number, (file, content) in enumerate(damaged):
                place = work / str(number)
                place.mkdir(parents=True)
                for other in file.folder.iterdir():
                    if other.is_file() and other.name != file.name:
                        (place / other.name).symlink_to(other)
                (place / file.name).write_bytes(content)
                readings.append((file.reader, place / file.main))
            return examine_all(readings)
        finally:
            shutil.rmtree(work, ignore_errors=True)


# ---- many of them --------------------------------------------------------------------------------------------------

#: Readers whose readings take long: each so many turns they have one.
LONG = {"adjust": 5, "layers": 5, "session": 3}
BATCH = 40  # readings of a process: a new one for each takes longer than most readings


def plan(files: Sequence[SoundFile], count: int) -> Iterator[tuple[SoundFile, str, int]]:
    """Yield which file is damaged how: readers in turn, their files, all kinds of damage."""
    kinds, readers = list(DAMAGES), {reader: [file for file in files if file.reader == reader] for reader in READERS}
    jobs = (
        (own[turn % len(own)], kinds[turn // len(own) % len(kinds)], number)
        for number in itertools.count()
        for reader, own in readers.items()
        for turn, rest in [divmod(number, LONG.get(reader, 1))]
        if own and not rest
    )
    return itertools.islice(jobs, count)


def main(count: int, seed: int, data: Path | None, kept: Path) -> int:
    """Damage files and have them read; keep and print what fails, print numbers by reader, return the failures."""
    counts: Counter[tuple[str, str]] = Counter()
    with tempfile.TemporaryDirectory(prefix="hrsi-damaged-") as name:
        laboratory = Laboratory(Path(name), sound_files(Path(name), data))
        for file in laboratory.files:
            counts[file.reader, "sound, but not read"] += laboratory.examine(file, file.content).how != "read"
        jobs = list(plan(laboratory.files, count))
        for batch in (jobs[start : start + BATCH] for start in range(0, count, BATCH)):
            contents = [laboratory.damaged(file, kind, seed * 1_000_000 + number) for file, kind, number in batch]
            endings = laboratory.examine_all([(job[0], content) for job, content in zip(batch, contents, strict=True)])
            for (file, kind, number), content, ending in zip(batch, contents, endings, strict=True):
                counts[file.reader, ending.how] += 1
                if ending.how not in ("read", "refused"):
                    kept.mkdir(parents=True, exist_ok=True)
                    (kept / f"{ending.how}-{file.reader}-{kind}-{number}-{file.name}").write_bytes(content)
                    print(f"{ending.how} {file.reader} {file.name} {kind} {number}: {ending.text}", flush=True)
    counts = +counts
    print(*(f"{reader}: {number} {how}" for (reader, how), number in sorted(counts.items())), sep="\n")
    return sum(number for (_, how), number in counts.items() if how not in ("read", "refused"))


if __name__ == "__main__":  # damaged_files.py FILES SEED FOLDER_OF_REAL_DATA|- FOLDER_OF_FAILURES
    number_of_files, first_seed, real, failures = sys.argv[1:]
    sys.exit(min(main(int(number_of_files), int(first_seed), None if real == "-" else Path(real), Path(failures)), 1))
