"""`rpc-info`: viewing geometry of images and pairs, and checks of their RPCs."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..hrsi_engine.block.imaging_geometry import ViewDirection, ViewGeometry, compute_all_pairs, find_rpc_warnings
from ..hrsi_engine.foundation.progress import advance
from ..hrsi_engine.ground.crs_operations import operations_of
from ..hrsi_engine.ground.geodesy import WGS84
from ..hrsi_engine.ground.geoids import how_to_get_grids
from ..hrsi_engine.ground.operation_uses import CrsOperation, OperationUse
from ..hrsi_engine.io.exact_cameras import find_exact_camera
from ..hrsi_engine.io.geopackage.declared_layers import PairRows, ViewRows
from ..hrsi_engine.io.geopackage.layers import Layer
from ..hrsi_engine.io.rasters.images import map_evidence, placement_doubt
from ..hrsi_engine.io.rasters.sun_angles import read_sun
from ..hrsi_engine.io.rpc_files import FoundRpc, read_rpc
from ..hrsi_engine.surface.grid_surface import ConstantHeight
from .declarations.rpcs import RPC_INFO_FILE, RpcInfoOptions
from .files.opening import open_images, open_terrain
from .files.result_folder import check_folder, plan_folder, tell, write_folder
from .interface.declare import Context, Report


def run(options: RpcInfoOptions, context: Context) -> Report:
    """Open the images, and report the geometry of each and of every pair."""
    check_folder(options.folder, context)
    images = open_images(options.images, context)
    surface, warnings = open_terrain(options.terrain), list[str]()
    if surface is None:
        surface = ConstantHeight(sum(image.middle_height_m for image in images) / len(images))
        warnings.append(
            f"the height of the ground is not known; {surface.height_m:.0f} m is the middle of the RPCs' height range. "
            "Footprints and overlaps depend on it: give `dem` or `height`"
        )
    tell(warnings, context)
    warnings += [f"{image.id}: {doubt}" for image in images if (doubt := placement_doubt(image))]  # logged already
    views = [ViewDirection(image, surface) for image in images]
    if context.dry_run:
        return plan_folder(options.folder, RPC_INFO_FILE, {"images": len(images)}, warnings, context)
    geometries: list[ViewGeometry] = []
    for number, view in enumerate(views):
        advance(context.progress, 0.5 * number / len(views), f"image {view.image.id}")
        # The lowest and highest ground, if the user gives its height
        given = options.terrain.dem.dem is not None or options.terrain.height is not None
        heights = view.terrain[:, 2] if given else np.zeros(0)
        doubts = find_rpc_warnings(view.image, (float(heights.min()), float(heights.max())) if heights.size else None)
        tell(doubts, context)  # before the geometry, which a damaged RPC may not have
        warnings += doubts
        geometries.append(view.geometry())
    advance(context.progress, 0.5, "pairs")
    pairs = compute_all_pairs(views)
    report: Report = {
        **context.record,
        "images": {
            view.image.id: _image_entry(view, geometry) for view, geometry in zip(views, geometries, strict=True)
        },
        "pairs": [
            {
                "first": pair.first,
                "second": pair.second,
                "overlap_first": pair.overlap[0],
                "overlap_second": pair.overlap[1],
                "convergence_deg": pair.convergence_deg,
                "base_to_height": pair.base_to_height,
            }
            for pair in pairs
        ],
        "crs_operations": _list_operations(options.crs, views),
        "warnings": warnings,
    }
    rows = [{"id": key, **entry} for key, entry in report["images"].items()]
    layers = [Layer("images", "Polygon", WGS84, [view.footprint for view in views], ViewRows.of_entries(rows))]
    if report["pairs"]:
        layers.append(Layer("pairs", "None", WGS84, [], PairRows.of_entries(report["pairs"])))
    write_folder(options.folder, report, RPC_INFO_FILE, layers, context)
    return report


def _list_operations(crs: str | None, views: Sequence[ViewDirection]) -> list[dict[str, Any]]:
    """Return the operations between a CRS and WGS84 at the position of the images: used ones first, then others.

    For operations that lack a grid, it is stated how to obtain it.
    """
    if crs is None:
        return []
    operations = operations_of(crs)
    place = np.concatenate([view.centre for view in views])
    taken = {use.number: use for use in operations.uses_at("images", place)}
    rows = [
        _operation_entry(operation, taken.get(number))
        for number, operation in enumerate(operations.operations)
        if number in taken or operation.covers(place).any()
    ]
    rows += [
        _operation_entry(operation, None, missing=True)
        for operation in operations.unavailable
        if operation.covers(place).any() and not operation.is_ballpark
    ]
    return sorted(rows, key=lambda row: (not row["taken"], row["accuracy_m"] is None, row["accuracy_m"] or 0.0))


def _operation_entry(operation: CrsOperation, use: OperationUse | None, missing: bool = False) -> dict[str, Any]:
    return {
        "name": operation.name,
        "code": operation.code or None,
        "accuracy_m": operation.accuracy_m,
        "sigma_plan_m": operation.sigma_m[0],
        "sigma_height_m": operation.sigma_m[1],
        "area": operation.area or None,
        "grid": ", ".join(operation.grids) or None,
        "taken": use is not None,
        "missing": missing,
        "advice": how_to_get_grids(", ".join(operation.grids), is_geoid=False) if missing else None,
    }


def _image_entry(view: ViewDirection, geometry: ViewGeometry) -> dict[str, Any]:
    """Return the report's entry of an image: its RPC and where that is from, viewing geometry, sun and footprint."""
    rpc, path = view.image.rpc, view.image.path
    found = read_rpc(path) if path else FoundRpc(rpc, "in memory")
    lon, lat, height = geometry.centre.tolist()
    sun = read_sun(path, rpc) if path else None
    exact = find_exact_camera(path, view.image.size) if path else None
    return {
        "path": view.image.path,
        "rpc_source": found.source,
        "rpc_ignored": list(found.ignored),
        "map_evidence": map_evidence(view.image),
        "samples": view.image.size[0] if view.image.size else None,
        "lines": view.image.size[1] if view.image.size else None,
        "lon": lon,
        "lat": lat,
        "height_m": height,
        "gsd_sample_m": geometry.gsd_sample_m,
        "gsd_line_m": geometry.gsd_line_m,
        "incidence_deg": geometry.incidence_deg,
        "azimuth_deg": geometry.azimuth_deg,
        "sun_azimuth_deg": None if sun is None else sun.angles.azimuth_deg,
        "sun_elevation_deg": None if sun is None else sun.angles.elevation_deg,
        "sun_source": "" if sun is None else sun.source,
        "rpc_height_min_m": rpc.height_range[0],
        "rpc_height_max_m": rpc.height_range[1],
        "err_bias_m": rpc.err_bias,
        "err_rand_m": rpc.err_rand,
        "exact_camera": exact and {"source": exact.source, **exact.compare_rpc(rpc, *rpc.height_range)},
        "footprint": geometry.footprint.tolist(),
    }


def summarise(report: Report) -> str:
    """Return a table of the images and one of the pairs."""
    width = max(len(name) for name in ("image", *report["images"]))
    lines = [f"{'image':{width}}   GSD sample  line   incidence  azimuth        lon        lat   height"]
    lines += [
        f"{name:{width}}   {image['gsd_sample_m']:8.2f} m {image['gsd_line_m']:5.2f} m "
        f"{image['incidence_deg']:7.1f} deg {image['azimuth_deg']:6.0f} deg "
        f"{image['lon']:10.5f} {image['lat']:10.5f} {image['height_m']:6.0f} m"
        for name, image in report["images"].items()
    ]
    lines += [
        f"{name}: its RPC differs from its exact camera ({exact['source']}) by {exact['rms_px']:.3f} px (RMS), "
        f"{exact['max_px']:.3f} px at most; in the mean {exact['mean_sample_px']:+.3f}, {exact['mean_line_px']:+.3f} px"
        for name, image in report["images"].items()
        if (exact := image["exact_camera"])
    ]
    lines += [f"{name}: {image['map_evidence']}" for name, image in report["images"].items() if image["map_evidence"]]
    if report["pairs"]:
        lines += ["", f"{'pair':{2 * width + 3}}   overlap        convergence    B/H"]
        for pair in report["pairs"]:
            overlap = f"{pair['overlap_first']:4.0%} / {pair['overlap_second']:4.0%}"
            lines.append(f"{pair['first']:{width}} - {pair['second']:{width}}   {overlap}")
            if pair["convergence_deg"] is not None:
                lines[-1] += f"   {pair['convergence_deg']:7.1f} deg   {pair['base_to_height']:6.3f}"
    if report["crs_operations"]:
        lines += ["", "         accuracy  coordinate operation to WGS84"]
        for row in report["crs_operations"]:
            state = "taken" if row["taken"] else "missing" if row["missing"] else ""
            accuracy = "?" if row["accuracy_m"] is None else f"{row['accuracy_m']:g} m"
            grid = f"; grid {row['grid']}" if row["grid"] else ""
            advice = f": {row['advice']}" if row["advice"] else ""
            lines.append(f"{state:8} {accuracy:>8}  {row['name']} ({row['code'] or 'no code'}){grid}{advice}")
    return "\n".join(lines)
