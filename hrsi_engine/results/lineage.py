"""What refined images say of themselves: how they came about, and how well they are oriented.

ERR_BIAS and ERR_RAND are, as RPC00B has them (STDI-0002), root mean squares in metres for each horizontal axis: of the
error that all points of an image share, and of what varies from point to point in it. Both follow from the covariance Q
of the camera's estimated parameters. On a grid over the image, with the derivatives of the ground position by them::

    B = G^-1 A        A by the parameters, G by east and north, both in pixels

    ERR_BIAS² = 1/2 tr(mean(B) Q mean(B)')         ERR_BIAS² + ERR_RAND² = 1/2 mean(tr(B Q B'))

Where the delivered camera is known not to follow a drift, that drift counts as an error too.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ..adjustment.result import Adjustment
from ..block.stack import stack_of
from ..foundation.errors import list_ids
from ..ground.map_crs import middle_position
from ..refinement.model import RefinedRPC
from .tables import positions

NODES = 5  # of the grid over an image, along each axis
MOST_IDS = 20
FROM_CHECKS, FROM_PREDICTION = "check points", "prediction"


def state_accuracy(result: Adjustment, refined: Sequence[RefinedRPC]) -> list[RefinedRPC]:
    """Return refined RPCs with ERR_BIAS and ERR_RAND as the adjustment predicts them.

    Parameters
    ----------
    result : Adjustment
        The adjustment.
    refined : sequence of RefinedRPC
        One an image. An RPC keeps its vendor's figures where nothing was estimated, or no covariance is known.

    Returns
    -------
    list of RefinedRPC
        In the same order.
    """
    height = float(middle_position(positions(result))[2])
    images = result.block.images
    grids = np.stack([image.grid_px(NODES, NODES) for image in images])
    which = np.repeat(np.arange(len(images)), NODES**2)
    ground = stack_of(images).localize(which, grids.reshape(-1, 2), height).reshape(len(images), -1, 3)
    stated = []
    for index, new in enumerate(refined):
        errors = _camera_errors_m(result, index, grids[index], ground[index])
        stated.append(
            new if errors is None else new._replace(rpc=replace(new.rpc, err_bias=errors[0], err_rand=errors[1]))
        )
    return stated


def _camera_errors_m(result: Adjustment, index: int, xy: np.ndarray, ground: np.ndarray) -> tuple[float, float] | None:
    """Return ERR_BIAS and ERR_RAND of an image by a grid on it and on the ground; None where they are not known."""
    image, cameras = result.block.images[index], result.cameras
    covariance, values = cameras.covariance[index], cameras.values[index]
    if not covariance.size or not np.isfinite(covariance).all() or not covariance.any():
        return None
    at = cameras.model.equations(image, xy)(values, ground)
    to_ground = np.linalg.inv(at.by_ground[:, :, :2])
    by_values = to_ground @ at.by_values
    drift_px = at.computed - result.model.project(image, result.values[index], ground)
    drift_m = (to_ground @ drift_px[:, :, None])[:, :, 0]
    mean, mean_drift = by_values.mean(axis=0), drift_m.mean(axis=0)
    shared = 0.5 * (np.trace(mean @ covariance @ mean.T) + np.sum(mean_drift**2))
    each = np.einsum("nip,pq,niq->n", by_values, covariance, by_values) + np.sum(drift_m**2, axis=1)
    total = 0.5 * float(each.mean())
    if not np.isfinite(total):
        return None
    return float(np.sqrt(max(shared, 0.0))), float(np.sqrt(max(total - shared, 0.0)))


def lineage_items(report: Mapping[str, Any], report_path: str) -> dict[str, str]:
    """Return what a refined image tells of itself, by the names of its metadata.

    Parameters
    ----------
    report : mapping
        The report of the run.
    report_path : str
        Where it will lie.

    Returns
    -------
    dict of str to str
        ``HRSI_VERSION`` and the like.
    """
    accuracy, source = block_accuracy(report)
    return {
        "HRSI_VERSION": report["version"],
        "HRSI_DATE": report["date"],
        "HRSI_ALGORITHM": report["algorithm"],
        "HRSI_MODEL": report["model"],
        "HRSI_BLOCK": list_ids(report["images"], MOST_IDS),
        "HRSI_REPORT": report_path,
        "HRSI_VERDICT": report["verdict"]["level"],
        **{f"HRSI_{name}_M": f"{value:.4g}" for name, value in accuracy.items() if value is not None},
        **({"HRSI_ACCURACY_FROM": source} if any(value is not None for value in accuracy.values()) else {}),
    }


def block_accuracy(report: Mapping[str, Any]) -> tuple[dict[str, float | None], str]:
    """Return CE90 and LE90 of the check points; without any, the worst that is predicted for a part of the block."""
    check = report["check"]
    if check["ce90_m"] is not None:
        return {"CE90": check["ce90_m"], "LE90": check["le90_m"]}, FROM_CHECKS
    found = {name: [part[f"{name.lower()}_m"] for part in report["parts"]] for name in ("CE90", "LE90")}
    return {
        name: max(values) if values and None not in values else None for name, values in found.items()
    }, FROM_PREDICTION
