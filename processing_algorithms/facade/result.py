"""Result of a call of the facade: the report, and the tables and files that the algorithm wrote, read on demand.

A picture of an adjusted block: its image points on the map, before and after the adjustment.

"Before" are the residuals by the delivered RPCs, "after" those of the report; both at the adjusted positions of the
points, so that they differ by the correction of the RPCs alone.
"""

import html
import os
from collections.abc import Sequence
from importlib import import_module, util
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from ...hrsi_engine.camera.rpc import RPC
from ...hrsi_engine.foundation.errors import InputError
from ...hrsi_engine.io.catalogue.block_records import RECORD_FILE, read_record
from ...hrsi_engine.io.geopackage.layer_tables import geopackage_layers, read_layer_table
from ...hrsi_engine.io.opening.files import read_json
from ...hrsi_engine.io.output_dir import find_image_outputs
from ...hrsi_engine.io.rpc_files import read_rpc
from .. import REGISTRY
from ..interface.declare import Report, spell_arguments
from ..projects.project_file import FOLDERS

#: Layers of short names: the first one that exists is used.
SHORT_NAMES = {
    "images": ("images",),
    "points": ("ground_points",),
    "image_points": ("image_points",),
    "residuals": ("residuals_wgs84", "residuals_utm"),
}


class Result:
    """The result of an algorithm, from the functions of `hrsi`, or by `hrsi.read_result` from a folder.

    Parameters
    ----------
    report : dict
        The report, as in ``report.json``.
    folder : path, optional
        Folder of the files; None if no files were written.
    kept : TemporaryDirectory, optional
        A temporary folder that is deleted with the result, if no ``output_dir`` was given.
    given : sequence
        The tables that were given: if one is of GeoPandas, tables are returned in the same way.
    """

    def __init__(
        self,
        report: Report,
        folder: str | os.PathLike[str] | None = None,
        kept: TemporaryDirectory[str] | None = None,
        given: Sequence[Any] = (),
    ) -> None:
        self.report = report
        self._located: Any = next((table for table in given if type(table).__name__ == "GeoDataFrame"), None)
        self.folder = None if folder is None else Path(folder)
        self._kept = kept

    @property
    def algorithm(self) -> str:
        """Name of the algorithm: ``triangulate``."""
        return str(self.report["algorithm"])

    @property
    def verdict(self) -> str:
        """``ok``, ``doubtful`` or ``unusable``; empty if the algorithm has no verdict."""
        return str(self.report.get("verdict", {}).get("level", ""))

    @property
    def reasons(self) -> list[dict[str, Any]]:
        """Reasons of the verdict, worst first: ``code``, ``level``, ``message``, ``advice``, ``images``, ``points``."""
        return list(self.report.get("verdict", {}).get("reasons", []))

    @property
    def warnings(self) -> list[str]:
        """Warnings for the user."""
        return [self._spell_text(text) for text in self.report.get("warnings", [])]

    def summary(self) -> str:
        """Return the lines that the command line prints at the end."""
        return self._spell_text(REGISTRY[self.algorithm].summarise(self.report))

    @property
    def is_project(self) -> bool:
        """Whether it is the result of a project, with a result for each of its steps."""
        return self.algorithm == "run"

    def step(self, name: str) -> "Result":
        """Return the result of a step of a project.

        Parameters
        ----------
        name : str
            ``triangulate``, ``orthorectify``, ``ortho-check`` or ``evaluate``.

        Returns
        -------
        Result
            Its report, tables and files.

        Raises
        ------
        InputError
            The step was left out or failed, or this is no result of `run`.
        """
        entry = self.report.get("steps", {}).get(name)
        if self.folder is None or not self.is_project or entry is None or "files" not in entry:
            raise InputError(
                f"{self.algorithm} has no result of a step {name!r}" + (f": {entry['told']}" if entry else "")
            )
        return read_result(self.folder / FOLDERS[name])

    # ---- tables ------------------------------------------------------------------------------------------------------

    @property
    def tables(self) -> list[str]:
        """Names of the layers that were written, for `table`."""
        return list(self._layers())

    def table(self, name: str) -> Any:
        """Return a layer.

        Parameters
        ----------
        name : str
            One of `tables`.

        Returns
        -------
        pandas.DataFrame, geopandas.GeoDataFrame or dict of arrays
            A GeoDataFrame with its CRS if one was given; a dict if pandas is not installed. Positions are ``lon, lat``
            or ``x, y``; footprints ``geometry`` (shapely), as in GeoPandas.

        Raises
        ------
        InputError
            There is no such layer.
        """
        layers = self._layers()
        if name not in layers:
            raise InputError(f"{self.algorithm} has no table {name!r}: it has {', '.join(layers) or 'none'}")
        if self._located is not None:
            return import_module("geopandas").read_file(layers[name], layer=name)
        return _make_frame(read_layer_table(layers[name], name))

    @property
    def images(self) -> Any:
        """Footprints of the images, one row each."""
        return self._short("images")

    @property
    def points(self) -> Any:
        """The adjusted ground points with standard deviations; for `project` and `localize` their results."""
        listed = self.report.get("points")
        if self.folder is None and isinstance(listed, list):
            frame = _make_frame(
                {name: _column([row[name] for row in listed]) for name in (listed[0] if listed else ())}
            )
            return frame if self._located is None else self._locate(frame)
        return self._short("points")

    @property
    def image_points(self) -> Any:
        """The measurements with their residuals, weights and flags; for `tie_points` those found."""
        return self._short("image_points")

    @property
    def residuals(self) -> Any:
        """The residuals: one row for each known point (``level`` ground) and each measurement (``level`` image)."""
        return self._short("residuals")

    # ---- files -------------------------------------------------------------------------------------------------------

    @property
    def files(self) -> list[Path]:
        """The files of the result."""
        return [] if self.folder is None else sorted(path for path in self.folder.rglob("*") if path.is_file())

    @property
    def rpcs(self) -> dict[str, RPC]:
        """The refined RPCs by image id. Raises `InputError` if none was written, with the reason of the verdict."""
        if not (written := find_image_outputs(self.report, self.folder)):
            worst = next((reason["message"] for reason in self.reasons), "none was asked for")
            raise InputError(f"{self.algorithm} wrote no refined RPC: {worst} (`write`, `force_write`)")
        return {name: read_rpc(path).rpc for name, path in written.items()}

    def _locate(self, frame: Any) -> Any:
        """Return points with a geometry: their ground position if known, otherwise the position that was given."""
        geopandas, given = import_module("geopandas"), self._located
        if "lon" in frame:
            places = geopandas.points_from_xy(frame["lon"], frame["lat"], frame["height"])
            return geopandas.GeoDataFrame(frame, geometry=places, crs="EPSG:4326")
        ids = given["id"].astype(str) if "id" in given else [str(row + 1) for row in range(len(given))]
        places = dict(zip(ids, given.geometry, strict=True))
        return geopandas.GeoDataFrame(frame, geometry=[places.get(str(name)) for name in frame["id"]], crs=given.crs)

    def _layers(self) -> dict[str, str]:
        """Return the file of each layer by the layer's name."""
        files = sorted(self.folder.glob("*.gpkg")) if self.folder is not None else []
        return {name: str(file) for file in files for name in geopackage_layers(str(file))}

    def _short(self, name: str) -> Any:
        """Return the table of a short name (`SHORT_NAMES`); raises `InputError` if the result has none."""
        there = self._layers()
        declared = [layer.rpartition("layername=")[2] for layer in REGISTRY[self.algorithm].layers]
        others = [] if name == "images" else [layer for layer in declared if layer != "images"]
        found = next((layer for layer in (*SHORT_NAMES[name], *others) if layer in there), None)
        if found is None:
            raise InputError(f"{self.algorithm} has no {name}: its tables are {', '.join(there) or 'none'}")
        return self.table(found)

    def _spell_text(self, text: str) -> str:
        return spell_arguments(text, REGISTRY[self.algorithm].params, lambda param: param.key)

    def plot(self) -> Any:
        """Draw the image points of an adjusted block on a map, with their residuals before and after.

        Returns
        -------
        matplotlib.figure.Figure
            Two maps with arrows in pixels; notebooks show it.

        Raises
        ------
        InputError
            The result is no adjusted block, or matplotlib is not installed.
        """
        folder = self.folder / FOLDERS["triangulate"] if self.folder is not None and self.is_project else self.folder
        if folder is None or not (folder / RECORD_FILE).exists():
            raise InputError(f"{self.algorithm} has no adjusted block to be drawn")
        return plot_block(folder)

    # ---- display -----------------------------------------------------------------------------------------------------

    def _headline(self) -> str:
        """Return one line on the result: the verdict, the number of points, or the first line of the summary."""
        if verdict := self.report.get("verdict"):
            return f"{verdict['level']}: {self._spell_text(verdict['sentence'])}"
        if isinstance(listed := self.report.get("points"), list):
            return f"{len(listed)} points" + (f" with {', '.join(listed[0])}" if listed else "")
        return self.summary().strip().partition("\n")[0] or "done"

    def __repr__(self) -> str:
        line = self._headline()
        return f"<{self.algorithm}: {line if len(line) <= 200 else line[:199] + '…'}>"

    def _repr_html_(self) -> str:
        """Return the display in a notebook: the verdict, its reasons, and control and check points."""
        parts = [f"<p><b>{html.escape(self.algorithm)}</b> {html.escape(self._headline())}</p>"]
        if self.reasons:
            told = (
                f"<li>{html.escape(self._spell_text(r['message']))} "
                f"<i>{html.escape(self._spell_text(r['advice']))}</i></li>"
                for r in self.reasons
            )
            parts.append(f"<ul>{''.join(told)}</ul>")
        rows = [(role, self.report[role]) for role in ("control", "check") if self.report.get(role, {}).get("points")]
        if rows:
            keys = [key for key in rows[0][1] if key.startswith("rmse_")]
            head = "".join(f"<th>{key.removeprefix('rmse_').replace('_', ' ')}</th>" for key in keys)
            body = "".join(
                f"<tr><td>{role}</td><td>{figures['points']}</td>"
                + "".join(f"<td>{'–' if value is None else f'{value:.3f}'}</td>" for value in map(figures.get, keys))
                + "</tr>"
                for role, figures in rows
            )
            parts.append(f"<table><tr><th>RMSE</th><th>points</th>{head}</tr>{body}</table>")
        return "".join(parts)


def read_result(folder: str | os.PathLike[str]) -> Result:
    """Return the result in the folder of an earlier run of the command line, QGIS or Python.

    Parameters
    ----------
    folder : path
        The run's ``output_dir``.

    Returns
    -------
    Result
        Its report, tables and files.

    Raises
    ------
    InputError
        The folder contains no ``report.json`` of HRSI.
    """
    path = Path(folder) / "report.json"
    report = read_json(str(path), "report")
    if not isinstance(report, dict) or report.get("algorithm") not in REGISTRY:
        raise InputError(f"{path}: is no report of HRSI: name the output directory of a run")
    return Result(report, folder)


def _column(values: list[Any]) -> np.ndarray:
    numbers = all(value is None or isinstance(value, (int, float)) for value in values)
    return np.array([np.nan if value is None else value for value in values]) if numbers else np.array(values)


def _make_frame(columns: dict[str, np.ndarray]) -> Any:
    """Return columns as a table of pandas if it is installed, otherwise unchanged."""
    return columns if util.find_spec("pandas") is None else import_module("pandas").DataFrame(columns)


ARROW_SHARE = 0.1  # length of a large arrow (nine of ten are shorter) over the width of the map


def plot_block(folder: Path) -> Any:
    """Return a figure of matplotlib with two maps of the block in a result folder."""
    try:
        pyplot = import_module("matplotlib.pyplot")
    except ImportError:
        raise InputError("plot needs matplotlib: install it, or look at report.html, which has this map") from None
    record = read_record(str(folder))
    layers = record.layer("image_points").partition("|")[0]
    table, footprints = read_layer_table(layers, "image_points"), read_layer_table(layers, "images")["geometry"]
    place = np.column_stack([table["lon"], table["lat"], table["height"]])
    after = np.column_stack([table["residual_sample_px"], table["residual_line_px"]])
    before, measured = np.full_like(after, np.nan), np.column_stack([table["sample"], table["line"]])
    for image in record.images:
        rows = table["image"] == image.id
        before[rows] = measured[rows] - image.rpc.project(place[rows])
    figure, axes = pyplot.subplots(1, 2, figsize=(11.0, 5.5), sharex=True, sharey=True, layout="constrained")
    for axis, residual, title in zip(axes, (before, after), ("before", "after"), strict=True):
        _draw_map(axis, footprints, place, residual, title)
        for role in dict.fromkeys(table["role"].tolist()):
            axis.plot(*place[table["role"] == role, :2].T, ".", markersize=4.0, label=role)
    axes[0].set_ylabel("latitude")
    axes[1].legend(loc="best", fontsize="small")
    return figure


def _draw_map(axis: Any, footprints: Any, place: np.ndarray, residual: np.ndarray, title: str) -> None:
    """Draw footprints, and residuals (n, 2) in pixels as arrows: sample to the right, line downwards."""
    for footprint in footprints:
        axis.plot(*footprint.exterior.xy, color="0.7", linewidth=0.8)
    length = np.hypot(*residual.T)
    known = np.isfinite(length) & (length > 0.0)
    rms = float(np.sqrt(np.mean(length[known] ** 2))) if known.any() else 0.0
    if known.any():
        arrows = axis.quiver(
            *place[known, :2].T,
            residual[known, 0],
            -residual[known, 1],
            color="0.3",
            angles="uv",
            scale=float(np.quantile(length[known], 0.9)) / ARROW_SHARE,
            scale_units="width",
            width=0.002,
        )
        axis.quiverkey(arrows, 0.85, 1.03, float(f"{rms:.1g}"), f"{rms:.1g} px", labelpos="E")
    axis.set_title(f"{title}: RMS {rms:.2g} px", loc="left")
    axis.set_xlabel("longitude")
    axis.locator_params(axis="x", nbins=4)
    axis.set_aspect(1.0 / np.cos(np.radians(float(np.mean(place[:, 1])))))
