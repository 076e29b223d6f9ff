"""The truth of a simulated block as a document and as tables, for files."""

from __future__ import annotations

from dataclasses import asdict, fields
from typing import Any, NamedTuple

import numpy as np

from ...block.points import ROLE_LABELS, Role
from .acquisitions import Acquisition
from .landscape import LAND_LATTICE, SPECTRAL_BANDS
from .pushbroom import PushbroomCamera
from .seasons import SeasonLandscape, park_cars
from .sensors import OrientationError
from .synthesis import BlockSimulation
from .vendor import VendorRPC


class TruthTable(NamedTuple):
    """Positions ``(n, 3)`` lon, lat, height and columns of length n."""

    positions: np.ndarray
    columns: dict[str, np.ndarray]


def make_truth_document(simulated: BlockSimulation) -> dict[str, Any]:
    """Return everything that is exactly so, ready for JSON; the tables have the points as well.

    Image points are ``[id, image, sample, line]``; blunders are named ``[id, image]``.

    Parameters
    ----------
    simulated : BlockSimulation
        The block.

    Returns
    -------
    dict
        Plain values.
    """
    truth, views = simulated.truth, simulated.views
    points = truth.image_points
    image_ids = np.array([view.id for view in views])
    gross = points.select(truth.blunder)
    return {
        "schema": 1,
        "conventions": {
            "image": "sample, line; (0, 0) is the centre of the first pixel",
            "ground": "lon, lat in degrees (WGS84), ellipsoidal height in metres",
            "orientation_error": "metres east, north, up at the scene centre; radians of roll, pitch, yaw",
        },
        "scene": asdict(simulated.spec)
        | {"relief_m": simulated.spec.relief_range_m, "height_range_m": list(truth.height_range_m)},
        "noise": asdict(simulated.noise),
        "images": {view.id: _describe_image(simulated, index) for index, view in enumerate(views)},
        "ground_points": {
            str(name): {"role": Role(role).label, "ground": position.tolist()}
            for name, role, position in zip(truth.ids, truth.role, truth.ground, strict=True)
        },
        "image_points": [
            [str(truth.ids[p]), str(image_ids[i]), *xy.tolist()]
            for p, i, xy in zip(points.point, points.image, points.xy, strict=True)
        ],
        "blunders": np.column_stack([truth.ids[gross.point], image_ids[gross.image]]).tolist(),
        "wrong_heights": truth.ids[truth.wrong_height].tolist(),
    }


def _describe_image(simulated: BlockSimulation, index: int) -> dict[str, Any]:
    """Return what an image was taken with: its view, true and stated orientation, and both RPCs."""
    truth = simulated.truth
    return asdict(simulated.views[index]) | {
        "gsd_m": list(truth.cameras[index].gsd_m()),
        "vendor_error": asdict(truth.vendor_cameras[index].error),
        "camera": _describe_camera(truth.cameras[index]),
        "vendor_rpc": _describe_fit(truth.vendor_rpcs[index]),
        "true_rpc": _describe_fit(truth.rpcs[index]),
        "bands": list(SPECTRAL_BANDS),
    }


def _describe_camera(camera: PushbroomCamera) -> dict[str, Any]:
    """Return the numbers that the physical model is made of."""
    document: dict[str, Any] = {}
    for field in fields(camera):
        value = getattr(camera, field.name)
        if isinstance(value, np.ndarray):
            value = value.tolist()
        elif field.name == "frame" or isinstance(value, OrientationError):
            value = asdict(value)
        document[field.name] = value
    return document


def _describe_fit(fit: VendorRPC) -> dict[str, Any]:
    """Return an RPC and how far it is from its physical camera, on the independent grid."""
    values = {field.name: getattr(fit.rpc, field.name) for field in fields(fit.rpc)}
    coefficients = {name: value.tolist() if isinstance(value, np.ndarray) else value for name, value in values.items()}
    return {"fit_max_px": fit.max_px, "fit_rms_px": fit.rms_px, "rpc": coefficients}


def make_truth_tables(simulated: BlockSimulation) -> dict[str, TruthTable]:
    """Return the tables ``true_ground_points``, ``true_image_points`` (at their ground positions) and ``objects``.

    Parameters
    ----------
    simulated : BlockSimulation
        The block.

    Returns
    -------
    dict of str to TruthTable
        By the tables' names.
    """
    truth = simulated.truth
    lon, lat, height = truth.ground.T
    surveyed = np.where(simulated.block.known[:, None], simulated.block.points.ground, np.nan).T
    columns = {
        "id": truth.ids,
        "role": ROLE_LABELS[truth.role],
        "lon": lon,
        "lat": lat,
        "height": height,
        "surveyed_lon": surveyed[0],
        "surveyed_lat": surveyed[1],
        "surveyed_height": surveyed[2],
        "wrong_height": truth.wrong_height,
    }
    return {
        "true_ground_points": TruthTable(truth.ground, columns),
        "true_image_points": _tabulate_image_points(simulated),
        "objects": _tabulate_objects(simulated),
        **({"changes": _tabulate_changes(simulated)} if simulated.acquisitions else {}),
    }


def _tabulate_image_points(simulated: BlockSimulation) -> TruthTable:
    """Return the exact image points next to the measured ones, at the true ground positions."""
    truth, points = simulated.truth, simulated.truth.image_points
    measured = simulated.block.measurements.xy
    columns = {
        "id": truth.ids[points.point],
        "role": ROLE_LABELS[truth.role][points.point],
        "image": np.array([view.id for view in simulated.views])[points.image],
        "sample": points.xy[:, 0],
        "line": points.xy[:, 1],
        "measured_sample": measured[:, 0],
        "measured_line": measured[:, 1],
        "blunder": truth.blunder,
    }
    return TruthTable(truth.ground[points.point], columns)


def _tabulate_objects(simulated: BlockSimulation) -> TruthTable:
    """Return the painted objects: centre, length, width and azimuth of the length."""
    objects, ground = simulated.scene.objects, simulated.scene.object_ground()
    columns = {
        "id": np.array([f"{kind}_{number}" for number, kind in enumerate(objects.kind)], dtype=str),
        "kind": objects.kind,
        "lon": ground[:, 0],
        "lat": ground[:, 1],
        "height": ground[:, 2],
        "length_m": objects.size_m[:, 0],
        "width_m": objects.size_m[:, 1],
        "azimuth_deg": np.degrees(objects.azimuth_rad),
    }
    if simulated.acquisitions:
        year = simulated.scene.chronicle
        columns |= {"height_m": year.height_m, "built_day": year.built_day, "torn_day": year.torn_day}
    return TruthTable(ground, columns)


def _tabulate_changes(simulated: BlockSimulation) -> TruthTable:
    """Return what is different on each date: at a place of the ground, what it is and since when or on which date.

    ``built`` and ``torn`` are buildings that are there or gone for the first time, ``ploughed`` and ``grown`` parcels
    that are bare or green again for the first time, ``car`` those on the roads that day; ``snow`` is at the centre.
    """
    scene, objects, year = simulated.scene, simulated.scene.objects, simulated.scene.chronicle
    rows: list[tuple[str, Acquisition, np.ndarray]] = []
    parcels = scene.landscape.parcels_within(scene.half_extent_m)
    centres = scene.landscape.parcel_centres(parcels)
    standing, bare = year.standing(-1.0), None
    for acquisition in simulated.acquisitions:
        season = SeasonLandscape.from_acquisition(scene.landscape, acquisition, scene.spec.lat_deg)
        now, ploughed = year.standing(acquisition.day), season.ploughed[tuple(parcels.T % LAND_LATTICE.parcels)]
        was_bare = ploughed if bare is None else bare
        places = {
            "built": objects.position_m[now & ~standing],
            "torn": objects.position_m[standing & ~now],
            "ploughed": centres[ploughed & ~was_bare],
            "grown": centres[was_bare & ~ploughed],
            "car": park_cars(scene.landscape, scene.half_extent_m, acquisition).position_m,
            "snow": np.zeros((int(acquisition.snow > 0.0), 2)),
        }
        rows += [(kind, acquisition, place) for kind, place in places.items()]
        standing, bare = now, ploughed
    count = [len(place) for _, _, place in rows]
    place = np.concatenate([place for _, _, place in rows])
    columns = {
        "kind": np.repeat([kind for kind, _, _ in rows], count),
        "date": np.repeat([acquisition.number for _, acquisition, _ in rows], count),
        "day": np.repeat([acquisition.day for _, acquisition, _ in rows], count),
        "snow": np.repeat([acquisition.snow for _, acquisition, _ in rows], count),
    }
    return TruthTable(scene.chart.to_ground(place, scene.terrain.height(*place.T)), columns)
