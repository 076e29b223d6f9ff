"""Results are written completely or not at all: into a hidden folder first, then moved into place.

Into a folder of GDAL's virtual file systems (``/vsis3/…``, ``/vsimem/…``) they are copied one by one, the report last.
"""

import os
import shutil
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Any

from osgeo import gdal

from ..foundation.errors import InputError
from ..foundation.interruption import holding_signals
from .opening.datasets import VIRTUAL, quiet, remove_virtual, virtual_status, write_virtual
from .opening.files import read_json
from .rpc_files.sidecars import is_rpc_file, keep_original
from .safety.content_marks import CONTENT_SAMPLING
from .safety.replacing import WRITE_AHEAD_LOG, require_not_read_only, temporary_folder
from .safety.transactions import Transaction, make_folder

RESULT_FILES = ("report.json", "block.gpkg")  # a folder with one of these contains a result


def check_output_dir(path: str, overwrite: bool, names: Iterable[str] = (), inputs: Iterable[str] = ()) -> None:
    """Check before the computation that its results can be written.

    path : the output folder; it need not exist
    overwrite : whether existing files may be replaced
    names : names of the files that will be written, as far as they are known in advance
    inputs : files that the run reads; neither they nor their side files are ever replaced

    Raises `InputError` if the folder is a file, or contains a result, other files of these names that may not be
    replaced, or inputs.
    """
    if os.path.exists(path) and not os.path.isdir(path):
        raise InputError(f"{path} is a file: name a directory as `output_dir`")
    results = [name for name in RESULT_FILES if exists_anywhere(os.path.join(path, name))]
    if results and not overwrite:
        message = f"already contains a result ({', '.join(results)}): allow `overwrite` or choose another directory"
        raise InputError(f"{path} {message}")
    _require_replaceable(path, names, inputs, overwrite)


def earlier_rpcs(path: str, inputs: Iterable[str]) -> list[str]:
    """Return the files with refined RPCs, and their STAC items, that an earlier run made in a folder, from its report.

    If a new report withholds its RPCs, these files would be mistaken for new ones. Images that the earlier run refined
    in place, and inputs, are not included.
    """
    input_paths = {os.path.realpath(file) for file in inputs}
    earlier = []
    report = read_report(os.path.join(path, "report.json")) or {}
    outputs, images = report.get("outputs"), report.get("images")
    output_pairs: list[tuple[Any, Any]] = [(outputs.get("stac"), "")] if isinstance(outputs, dict) else []
    for image in images.values() if isinstance(images, dict) else ():
        output_pairs += [(image.get(key), image.get("path")) for key in ("output", "stac")]
    for output, source in output_pairs:
        if not isinstance(output, str) or not isinstance(source, str):
            continue
        file = os.path.join(path, os.path.basename(output))
        if os.path.isfile(file) and os.path.realpath(file) not in input_paths | {os.path.realpath(source)}:
            earlier.append(file)
    return earlier


@contextmanager
def stage_folder(
    path: str,
    inputs: Iterable[str],
    overwrite: bool = False,
    transaction: Transaction | None = None,
    discarded: Iterable[str] = (),
) -> Iterator[Path]:
    """Yield a temporary folder; its files move into ``path`` together when the block ends without an exception.

    path : the output folder; created if it is missing
    inputs : files that the run reads; neither they nor their side files are ever replaced
    overwrite : whether other existing files may be replaced; a vendor's RPC file is then kept as ``.original``
    transaction : other changes, which are made together with these: all or none
    discarded : folders that are removed together with these changes

    Raises `InputError` if a result would replace an input, or a file that may not be replaced.
    """
    if path.startswith(VIRTUAL):
        with tempfile.TemporaryDirectory(prefix="hrsi-unfinished-") as local:
            yield Path(local)
            files = sorted(Path(local).iterdir(), key=lambda file: file.name == "report.json")
            _require_replaceable(path, [file.name for file in files], inputs, overwrite)
            if transaction is not None:
                transaction.commit()
            for file in files:
                with open(file, "rb") as source:
                    blocks = iter(partial(source.read, CONTENT_SAMPLING.whole_bytes), b"")
                    write_virtual(f"{path.rstrip('/')}/{file.name}", blocks)
            for needless in discarded:
                remove_virtual(needless)
        return
    folder = Path(path)
    is_new = not folder.exists()
    temporary = None
    changes = transaction or Transaction(str(folder))
    try:
        with holding_signals():  # a signal between creating and storing the folder would leave it behind
            make_folder(str(folder))
            temporary = Path(temporary_folder(path))
        for needless in discarded:
            changes.discard(needless)
        yield temporary
        with changes:
            _move_into_place(temporary, folder, inputs, overwrite, changes)
    except BaseException:
        if temporary is not None and not changes.is_under_way:
            shutil.rmtree(temporary, ignore_errors=True)
        if is_new and folder.is_dir() and not any(folder.iterdir()):
            folder.rmdir()
        raise
    with holding_signals():
        shutil.rmtree(temporary, ignore_errors=True)


def _move_into_place(
    temporary: Path, folder: Path, inputs: Iterable[str], overwrite: bool, changes: Transaction
) -> None:
    # The report last: it states that the others exist
    files = sorted(temporary.iterdir(), key=lambda file: file.name == "report.json")
    _require_replaceable(str(folder), [file.name for file in files], inputs, overwrite)
    for file in files:
        target = folder / file.name
        if file.suffix == ".gpkg":
            for suffix in WRITE_AHEAD_LOG:  # SQLite would apply an old log to the new file
                changes.remove(f"{target}{suffix}")
        keep_original(str(target), changes)
        changes.rename(str(file), str(target))
    changes.commit()


def _require_replaceable(path: str, names: Iterable[str], inputs: Iterable[str], overwrite: bool) -> None:
    """Raise `InputError` if a file of these names exists and is an input, or may not be replaced."""
    targets = [os.path.join(path, name) for name in names]
    require_no_input(targets, inputs)
    replaceable = set() if overwrite else names_of_last_run(path)
    for target in targets:
        if not overwrite and os.path.basename(target) not in replaceable and exists_anywhere(target):
            raise InputError(
                f"{target} exists and would be replaced: allow `overwrite`, or choose another `output_dir`"
            )


def require_no_input(targets: Iterable[str], inputs: Iterable[str]) -> None:
    """Raise `InputError` if a file that would be written exists and is read-only, or is an input under any path.

    Side files of an input are not replaced either, except its RPC files, of which `keep_original` keeps the originals.
    """
    existing = [target for target in targets if exists_anywhere(target)]
    if not existing:
        return
    inputs = [
        file
        for name in inputs
        for file in ([one.path for one in os.scandir(name) if one.is_file()] if os.path.isdir(name) else [name])
    ]
    read, side_identities = ({_identity(file) for file in files} for files in (inputs, files_with(inputs)))
    for target in existing:
        if _identity(target) in read:
            raise InputError(f"{target} is an input and would be replaced: choose another `output_dir`")
        if _identity(target) in side_identities and not is_rpc_file(target):
            raise InputError(f"{target} belongs to an input and would be replaced: choose another `output_dir`")
        require_not_read_only(target)


def _identity(path: str) -> object:
    """Return the identity of a file, equal for all its paths and links; if it does not exist, its path."""
    try:
        status = os.stat(path)
    except OSError:
        return os.path.realpath(path)
    return status.st_dev, status.st_ino


def require_plain_name(name: str) -> None:
    """Raise `InputError` if an id that becomes part of a file's name would lead out of its folder."""
    if not name or name in (".", "..") or set(name) & {"/", "\\", "\0"} or os.path.basename(name) != name:
        raise InputError(f"the id {name!r} is no name of a file: leave out what leads to other folders")


def names_of_last_run(folder: str) -> set[str]:
    """Return the names of the result files in a folder, from the report of an earlier run there."""
    report = read_report(os.path.join(folder, "report.json"))
    if report is None:
        return set()
    outputs = report.get("outputs", [])
    output_list = [*(outputs.values() if isinstance(outputs, dict) else outputs)]
    output_list += find_image_outputs(report).values()
    return {"report.json", *(os.path.basename(file) for file in output_list if isinstance(file, str))}


def read_report(path: str) -> dict[str, Any] | None:
    """Return a report that HRSI wrote; None if there is none."""
    try:
        report = read_json(path, "report")
    except InputError:
        return None
    return report if isinstance(report, dict) and {"schema", "algorithm"} <= report.keys() else None


def find_image_outputs(report: Mapping[str, Any], folder: str | os.PathLike[str] | None = None) -> dict[str, str]:
    """Return the output file of each image according to a report, by image id.

    With the ``folder`` of a result, which may have been moved since, it is the file of this name there, if it exists.
    Otherwise it is the file as named; a relative path may refer to the folder in which the run was started.
    """
    images = report.get("images")
    entries = images.items() if isinstance(images, dict) else ()
    outputs = {name: one["output"] for name, one in entries if isinstance(one, dict) and one.get("output")}
    if folder is None:
        return outputs
    places = {
        name: (os.path.join(folder, os.path.basename(path)), path, os.path.join(report.get("directory", ""), path))
        for name, path in outputs.items()
    }
    return {name: next(filter(os.path.isfile, places[name]), path) for name, path in outputs.items()}


def exists_anywhere(path: str) -> bool:
    """Return whether a file exists, on disk or in one of GDAL's virtual file systems."""
    return virtual_status(path) is not None if path.startswith(VIRTUAL) else os.path.exists(path)


def files_with(inputs: Iterable[str]) -> list[str]:
    """Return the input files and the files that GDAL lists with them: side files, parts, sources of a VRT."""
    files = list(inputs)
    for file in tuple(files):
        with quiet(), suppress(RuntimeError, SystemError, UnicodeDecodeError):
            gdal.ErrorReset()
            dataset = gdal.OpenEx(file)
            files += (dataset.GetFileList() or []) if dataset is not None else []
    return files
