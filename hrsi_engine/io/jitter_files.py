"""The file ``jitter.csv`` next to refined RPCs: the displacement of each image line by vibration of the sensor.

For each image a comment has a ground point and its position by the image's RPC, which identifies that RPC.
"""

import csv
import io
import os
from collections.abc import Mapping

import numpy as np

from ..block.jitter_curve import JitterCurve
from ..camera.rpc import RPC
from ..foundation.errors import InputError
from ..foundation.thresholds import EQUALITY

JITTER_FILE = "jitter.csv"
JITTER_COLUMNS = ("image", "line", "d_sample", "d_line", "sigma_sample", "sigma_line")


def write_jitter(path: str, curves: Mapping[str, JitterCurve], rpcs: Mapping[str, RPC]) -> None:
    """Write the jitter curves of images; ``rpcs`` are their refined RPCs, which the file identifies. Keys are ids."""
    with open(path, "w", encoding="utf-8", newline="") as file:
        file.write("# image position (px) = position by the RPC + displacement at its line; HRSI\n")
        rows = csv.writer(file)
        for name in curves:
            r = rpcs[name]
            ground = np.array([r.long_off + 0.5 * r.long_scale, r.lat_off - 0.5 * r.lat_scale, r.height_off])
            values = [*ground.tolist(), *r.project(ground[None])[0].tolist()]
            rows.writerow(["#rpc", name, *(f"{value:.9f}" for value in values)])
        rows.writerow(JITTER_COLUMNS)
        for name, curve in curves.items():
            line = curve.first_line + np.arange(len(curve.shift_px))
            numbers = np.column_stack([line, curve.shift_px, curve.sigma_px])
            row = io.StringIO(newline="")
            csv.writer(row).writerow([name.replace("%", "%%"), "%d", *["%.4f"] * 4])
            file.write((row.getvalue() * len(line)) % tuple(numbers.ravel().tolist()))  # twice as fast as by rows


class JitterFile:
    """A jitter file, read once for all images; damaged rows raise an error when their image's curve is requested."""

    def __init__(self, path: str) -> None:
        self.path, self._lines = path, dict[str, list[str]]()
        try:
            with open(path, encoding="utf-8", newline="") as file:
                for line in file:
                    # Image of a row, or of a comment ``#rpc``; other comments begin with no id
                    row = line.removeprefix("#rpc,")
                    name = next(csv.reader([row]), [""])[0] if row.startswith('"') else row.partition(",")[0]
                    self._lines.setdefault(name, []).append(line)
        except (OSError, ValueError, csv.Error) as error:
            raise InputError(f"{path}: cannot be read ({error}): adjust the block again") from None

    @property
    def ids(self) -> set[str]:
        """Ids of the images that have a curve."""
        return {name for name, lines in self._lines.items() if any(line.startswith("#rpc,") for line in lines)}

    def find_curve(self, image_id: str, rpc: RPC) -> tuple[JitterCurve | None, str]:
        """Return the curve of an image and an empty text; without a curve None, and a message if it is for another RPC.

        Raises `InputError` if its rows are damaged.
        """
        lines, values, reference = list[int](), list[list[float]](), None
        try:
            for row in csv.reader(self._lines.get(image_id, [])):
                if row[0] == "#rpc":
                    reference = np.array([float(value) for value in row[2:]])
                else:
                    lines.append(int(row[1]))
                    values.append([float(value) for value in row[2:6]])
            table = np.array(values).reshape(-1, 4)
            sound = (
                reference is not None
                and len(reference) == 5
                and np.isfinite(table).all()
                and (np.diff(lines) == 1).all()
            )
            if lines and not sound:
                raise ValueError("lines are missing")
        except (ValueError, IndexError, csv.Error) as error:
            raise InputError(
                f"{self.path}: its jitter of {image_id} is damaged ({error}): adjust the block again"
            ) from None
        if not lines or reference is None:
            return None, ""
        if not np.abs(rpc.project(reference[None, :3])[0] - reference[3:]).max() <= EQUALITY.file_px:
            return None, f"{image_id}: {self.path} is of another RPC than the image has, and was not used"
        return JitterCurve(lines[0], table[:, :2], table[:, 2:]), ""


def find_jitter_file(image_path: str) -> str | None:
    """Return the jitter file in the folder of an image, None if there is none."""
    path = os.path.join(os.path.dirname(image_path), JITTER_FILE)
    return path if os.path.isfile(path) else None
