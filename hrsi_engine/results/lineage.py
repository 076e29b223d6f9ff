"""Metadata of refined images: their lineage and their accuracy.

ERR_BIAS and ERR_RAND are defined as in RPC00B (STDI-0002): root mean squares in metres for each horizontal axis, of the
error common to all points of an image, and of the part that varies from point to point. Both follow from the covariance
Q of the camera's estimated parameters. On a grid over the image, with the derivatives of the ground position by them::

    B = G^-1 A        A by the parameters, G by east and north, both in pixels

    ERR_BIAS² = 1/2 tr(mean(B) Q mean(B)')         ERR_BIAS² + ERR_RAND² = 1/2 mean(tr(B Q B'))

A drift that was estimated but is not contained in the final camera counts as an error, too.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ..adjustment.result import Adjustment
from ..block.block import stack_rpcs
from ..foundation.errors import list_ids
from ..foundation.large_arrays import invert_2x2
from ..foundation.thresholds import GRIDS, LISTS, MEMORY
from ..refinement.model import RefitRPC
from ..refinement.stacked_cameras import linearise_images, project_to_images

FROM_CHECKS, FROM_PREDICTION = "check points", "prediction"


def state_accuracy(result: Adjustment, refined: Sequence[RefitRPC]) -> list[RefitRPC]:
    """Return the refined RPCs, in their order, with ERR_BIAS and ERR_RAND predicted by the adjustment.

    An RPC keeps its vendor's figures if nothing was estimated, or no covariance is known.
    """
    height = result.middle[2]
    images = result.block.images
    stated = list(refined)
    step = MEMORY.rows // GRIDS.coarse**2  # images whose grids are in memory together
    for first in range(0, len(images), step):
        part = range(first, min(first + step, len(images)))
        bias, rand = _camera_errors_m(result, part, height)
        for index in np.flatnonzero(np.isfinite(bias + rand)).tolist():
            new = stated[part[index]]
            rpc = replace(new.rpc, err_bias=float(bias[index]), err_rand=float(rand[index]))
            stated[part[index]] = new._replace(rpc=rpc)
    return stated


def _camera_errors_m(result: Adjustment, part: range, height: float) -> tuple[np.ndarray, np.ndarray]:
    """Return ERR_BIAS and ERR_RAND ``(k,)`` of the images of a part of the block; NaN if they are not known."""
    images, cameras = result.block.images[part.start : part.stop], result.cameras
    of_part = slice(part.start, part.stop)
    covariance, values = cameras.covariance[of_part], cameras.values[of_part]
    bias, rand = np.full((2, len(images)), np.nan)
    finite = np.flatnonzero(np.isfinite(covariance).all(axis=(1, 2)) & covariance.any(axis=(1, 2)))
    if not len(finite):
        return bias, rand
    images_known, covariance = [images[index] for index in finite.tolist()], covariance[finite]
    xy = np.concatenate([image.grid_px(GRIDS.coarse, GRIDS.coarse) for image in images_known])
    image_index = np.repeat(np.arange(len(images_known)), GRIDS.coarse**2)
    ground = stack_rpcs(images_known).localize(image_index, xy, height)
    linearised = linearise_images(cameras.model, images_known, image_index, xy, values[finite], ground)
    delivered = project_to_images(result.model, images_known, image_index, result.values[of_part][finite], ground)
    to_ground = invert_2x2(linearised.by_ground[:, :, :2])
    by_values = (to_ground @ linearised.by_values).reshape(len(images_known), GRIDS.coarse**2, 2, -1)
    drift_m = (to_ground @ (linearised.computed - delivered)[:, :, None]).reshape(len(images_known), GRIDS.coarse**2, 2)
    mean, mean_drift = by_values.mean(axis=1), drift_m.mean(axis=1)
    systematic = 0.5 * (np.sum((mean @ covariance) * mean, axis=(1, 2)) + np.sum(mean_drift**2, axis=1))
    flat = by_values.reshape(len(images_known), 2 * GRIDS.coarse**2, -1)
    squares = np.sum((flat @ covariance) * flat, axis=(1, 2)) + np.sum(drift_m**2, axis=(1, 2))
    total = 0.5 * squares / GRIDS.coarse**2
    # Errors of coordinate operations and of the pointing of a pass shift an image as a whole, at a given height
    if result.shared_shifts_m is not None:
        at_height = (to_ground @ linearised.by_ground).reshape(len(images_known), GRIDS.coarse**2, 2, 3).mean(axis=1)
        rows, mean_m = result.block.measurements, np.zeros((len(finite), *result.shared_shifts_m.shape[1:]))
        for place, image in enumerate((part.start + finite).tolist()):  # the mean shift of the points on an image
            shifts = result.shared_shifts_m[rows.point[rows.image == image]]
            shifts = shifts[np.isfinite(shifts).all(axis=(1, 2))]
            mean_m[place] = shifts.mean(axis=0) if len(shifts) else 0.0
        of_shifts = 0.5 * np.sum((at_height @ mean_m) ** 2, axis=(1, 2))
        systematic, total = systematic + of_shifts, total + of_shifts
    total[~np.isfinite(total)] = np.nan
    bias[finite] = np.sqrt(np.maximum(systematic, 0.0))
    rand[finite] = np.sqrt(np.maximum(total - systematic, 0.0))
    return bias, rand


def lineage_items(report: Mapping[str, Any], report_path: str) -> dict[str, str]:
    """Return the metadata of refined images, by the names of the items (``HRSI_VERSION`` and similar ones)."""
    accuracy, source = block_accuracy(report)
    # The coordinate operations of a report in one line, each once, without the exact ones
    names = [
        f"{entry['name']} ({entry['code'] or 'no code'}, "
        f"{'accuracy unknown' if entry['accuracy_m'] is None else format(entry['accuracy_m'], 'g') + ' m'})"
        for entry in (report.get("crs_operations") or ())
        if entry["accuracy_m"] != 0.0
    ]
    operations = "; ".join(dict.fromkeys(names))
    return {
        "HRSI_VERSION": report["version"],
        "HRSI_DATE": report["date"],
        "HRSI_ALGORITHM": report["algorithm"],
        "HRSI_MODEL": report["model"],
        "HRSI_BLOCK": list_ids(report["images"], LISTS.images),
        "HRSI_REPORT": report_path,
        "HRSI_VERDICT": report["verdict"]["level"],
        **({"HRSI_CRS_OPERATIONS": operations} if operations else {}),
        **{f"HRSI_{name}_M": f"{value:.4g}" for name, value in accuracy.items() if value is not None},
        **({"HRSI_ACCURACY_FROM": source} if any(value is not None for value in accuracy.values()) else {}),
    }


def block_accuracy(report: Mapping[str, Any]) -> tuple[dict[str, float | None], str]:
    """Return CE90 and LE90 of the check points; without any, the worst predicted ones of the parts of the block."""
    check, untested = report["check"], report.get("untested_by_check_points")
    if check["ce90_m"] is not None:
        keys = {"CE90": "ce90_m", "LE90": "le90_m"}
        return {name: add_untested_error(check[key], untested, key) for name, key in keys.items()}, FROM_CHECKS
    result = {name: [part[f"{name.lower()}_m"] for part in report["parts"]] for name in ("CE90", "LE90")}
    return {
        name: max(values) if values and None not in values else None for name, values in result.items()
    }, FROM_PREDICTION


def add_untested_error(measured: float | None, untested: Mapping[str, float | None] | None, key: str) -> float | None:
    """Return a figure of check points (``ce90_m`` or ``le90_m``, the key) including the errors that they cannot test.

    None if it was not measured.
    """
    if measured is None or untested is None:
        return measured
    return float(np.hypot(measured, untested[key] or 0.0))
