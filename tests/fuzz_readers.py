"""Coverage-guided fuzzing of the readers that are Python: every input ends soon, with a result or an `InputError`.

``python tests/fuzz_readers.py [--seconds N] [--readers R …] [--corpus FOLDER]`` fuzzes each reader for some seconds in
a process of its own, with Atheris (libFuzzer with the coverage of Python code). An input that fails is kept in the
folder of the corpus and named. The inputs begin with sound files (`damaged_files.sound_files`); readers that are GDAL's
C++ code have no coverage to be guided by: for those and for whole commands there is `damaged_files.py`.
"""

import argparse
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ[_name] = "1"
MOST_SECONDS, MOST_MIB = 10, 2048  # of one input
LONGEST_INPUT = 150_000  # bytes
#: What is fuzzed: the name under which the content is written (the reader goes by it), and names of sound files.
NAMES: dict[str, tuple[str, tuple[str, ...]]] = {
    "rpb": ("x.RPB", (".RPB",)),
    "rpc-txt": ("x_RPC.TXT", ("_RPC.TXT", "rpc_IKONOS.txt")),
    "isd": ("x.XML", ("rpc_WV2.xml",)),
    "dimap": ("RPC_x.XML", ("rpc_SPOT6.xml", "rpc_PLEIADES.xml")),
    "geom": ("x.geom", (".geom",)),
    "rpcm-json": ("x.json", ("JAX_068_001_RGB.json",)),
    "tiff": ("x.tif", ("c.tif", "d.tif")),
    "csv": ("x.csv", ("points.csv", "image_points.csv", "points.txt")),
    "micmac": ("PMUL-image_1.csv", ("PMUL-image_1.csv",)),
    "qgis-points": ("image_1.points", (".points",)),
    "asp-gcp": ("x.gcp", (".gcp",)),
    "asp-match": ("run-image_1__image_2.match", (".match",)),
    "orthority": ("x.geojson", ("orthority.geojson",)),
    "geopackage": ("x.gpkg", ("points.gpkg",)),
    "cache": ("part.npz", ("part.npz",)),
    "report": ("report.json", ("report.json",)),
    "journal": (".hrsi-journal.json", (".hrsi-journal.json",)),
}


def fuzz(reader: str, corpus: Path, seconds: int) -> None:
    """Fuzz one reader in this process; libFuzzer ends it."""
    import atheris

    with atheris.instrument_imports(include=["hrsi"], enable_loader_override=False):
        from hrsi.hrsi_engine.foundation.errors import InputError
        from hrsi.hrsi_engine.io.output_dir import names_of_last_run
        from hrsi.hrsi_engine.io.point_files import read_points
        from hrsi.hrsi_engine.io.rpc_files import RPC_READERS
        from hrsi.hrsi_engine.io.rpc_files.tiff_tag import read_directory, read_value
        from hrsi.hrsi_engine.io.safety.array_files import PartStore
        from hrsi.hrsi_engine.io.safety.transactions import recover_folders

    def read_tiff(path: str) -> object:
        directory = read_directory(path)
        return None if directory is None else [read_value(path, directory, entry.tag) for entry in directory.entries]

    def points(path: str) -> object:
        return read_points(path, image_ids=["image_1", "image_2"], height_datum="ellipsoidal", ground_crs="EPSG:4979")

    folder_readers: dict[str, Callable[[str], object]] = {
        "cache": lambda folder: PartStore(folder).load("part"),
        "report": names_of_last_run,
        "journal": lambda folder: recover_folders([folder]),
    }
    read: Callable[[str], object] = points
    if reader in RPC_READERS:
        read = RPC_READERS[reader].read
    elif reader == "tiff":
        read = read_tiff
    folder = Path(tempfile.mkdtemp())
    path = folder / NAMES[reader][0]

    def read_once(content: bytes) -> None:
        path.write_bytes(content)
        try:
            if reader in folder_readers:
                folder_readers[reader](str(folder))
            else:
                read(str(path))
        except InputError as error:
            if "\n" in str(error) or path.name not in str(error):
                raise RuntimeError(f"not one line that names the file: {error}") from error

    words = [
        sys.argv[0], str(corpus), f"-max_total_time={seconds}", f"-timeout={MOST_SECONDS}", f"-max_len={LONGEST_INPUT}",
        f"-rss_limit_mb={MOST_MIB}", f"-artifact_prefix={corpus.parent}/failed-{reader}-",
    ]  # fmt: skip
    atheris.Setup(words, read_once)
    atheris.Fuzz()


def fill(corpus: Path, data: Path | None) -> None:
    """Write sound files into a folder for each reader, from which the inputs begin."""
    sys.path.insert(0, str(Path(__file__).parent))
    from damaged_files import sound_files

    with tempfile.TemporaryDirectory() as name:
        files = sound_files(Path(name), data)
        for reader, (_, endings) in NAMES.items():
            folder = corpus / reader
            folder.mkdir(parents=True, exist_ok=True)
            for file in files:
                if file.name.endswith(endings) and len(file.content) <= LONGEST_INPUT:
                    (folder / f"{file.reader}-{file.name}").write_bytes(file.content)


def main() -> int:
    """Fuzz all readers one after the other; return 1 where an input failed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=int, default=60)
    parser.add_argument("--readers", nargs="*", choices=NAMES, default=list(NAMES))
    parser.add_argument("--corpus", type=Path)
    parser.add_argument("--data", type=Path, default=os.environ.get("HRSI_TEST_DATA"))
    parser.add_argument("--alone", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.alone:
        fuzz(options.readers[0], options.corpus / options.readers[0], options.seconds)
    corpus = options.corpus or Path(tempfile.mkdtemp(prefix="hrsi-corpus-"))
    fill(corpus, options.data)
    failed = 0
    for reader in options.readers:
        words = [sys.executable, __file__, "--alone", "--readers", reader, "--corpus", str(corpus)]
        words += ["--seconds", str(options.seconds)]
        with tempfile.TemporaryDirectory(
            prefix="hrsi-fuzz-", dir="/dev/shm" if os.path.isdir("/dev/shm") else None
        ) as own:
            environment = os.environ | {"TMPDIR": own}
            done = subprocess.run(words, capture_output=True, text=True, check=False, env=environment)
        runs = sum(int(line.split("Done ")[1].split()[0]) for line in done.stderr.splitlines() if "Done " in line)
        covered = [line for line in done.stderr.splitlines() if " cov: " in line]
        reached = covered[-1].split(" cov: ")[1].split()[0] if covered else "?"
        print(f"{reader:12} {runs:9} inputs, {reached} branches" + (" FAILED" if done.returncode else ""), flush=True)
        if done.returncode:
            failed += 1
            print(done.stdout[-3000:], done.stderr[-3000:])
    print(f"corpus and failed inputs: {corpus}")
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main())
