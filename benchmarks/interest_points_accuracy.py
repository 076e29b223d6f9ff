"""Accuracy of automatic interest points on simulated pairs against their truth.

    python benchmarks/interest_points_accuracy.py [--size 1200]

Prints, for scenes whose tanks and roundabouts have diameters of about 15 and 40 px: errors of centres and corners,
repeatability between two views 24 degrees apart (tolerance 1.5 px, carried over by the true cameras and the true
terrain), and how well centres and corners register the two views and PAN with MS at 1:4. Blur 0.5 px, noise
2 DN and shot noise as `simulate` has them.
"""

from __future__ import annotations

import argparse

import numpy as np

from hrsi.hrsi_engine.measurement.interest_points import detect_interest_points
from hrsi.hrsi_engine.measurement.targets import TargetOptions, measure_target
from hrsi.hrsi_engine.simulation import SimulatedBlock, renderer
from hrsi.tests.object_scenes import (
    VIEWS,
    TrueObjects,
    alike,
    carried,
    centre_errors,
    detected,
    pairs,
    repeatability,
    rms,
    scene,
    true_objects,
)

SCALES = {"15 px": 0.55, "40 px": 1.4}
SEEDS = (8, 10)  # scenes with many tanks at both scales


def main() -> None:
    """Print all figures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--size", type=int, default=1200)
    given = parser.parse_args()
    for label, scale in SCALES.items():
        for seed in SEEDS:
            simulated = scene(scale, given.size, seed=seed)
            print(f"== diameters about {label}, seed {seed}")
            print_scene(simulated)


def print_scene(simulated: SimulatedBlock) -> None:
    """Print the figures of one pair."""
    images = [renderer(simulated, view) for view in VIEWS]
    truth = [true_objects(simulated, image) for image in images]
    centres, corners = detected(simulated, "centres"), detected(simulated, "harris")
    for kinds in (("tank", "island"), ("target",), ("roof",)):
        parts = [centre_errors(true, points, kinds) for true, points in zip(truth, centres, strict=True)]
        print_errors("/".join(kinds), np.concatenate([p[0] for p in parts]), np.concatenate([p[1] for p in parts]))
    print_measured_corners(images[0], truth[0])
    print_registration(simulated, images, centres, corners)
    print_multispectral(simulated, images[0], centres[0], corners[0])


def print_errors(name: str, errors: np.ndarray, found: np.ndarray) -> None:
    """Print what share of objects was found and how well."""
    if not len(errors):
        print(f"centres of {name}: none of {len(found)} found")
        return
    size = np.hypot(*errors.T)
    print(
        f"centres of {name}: {found.sum()} of {len(found)} found, rmse {rms(errors):.3f} px a coordinate, "
        f"median {np.median(size):.3f}, largest {size.max():.2f}"
    )


def print_measured_corners(image: object, truth: TrueObjects) -> None:
    """Print the errors of roof corners measured by the intersection of edges, started 2 px off."""
    rng = np.random.default_rng(1)
    errors, asked = [], 0
    for index in np.flatnonzero(truth.kind == "roof")[:40]:
        true = truth.corners[index, 0]
        asked += 1
        made = measure_target(image, true + rng.uniform(-2.0, 2.0, 2), "corner", TargetOptions(search_px=6.0))  # type: ignore[arg-type]
        if not made.refusal:
            errors.append(made.xy - true)
    if errors:
        array = np.array(errors)
        print(
            f"roof corners by edges: {len(array)} of {asked} measured, rmse {rms(array):.3f} px a coordinate, "
            f"median {np.median(np.hypot(*array.T)):.3f}"
        )


def print_registration(simulated: SimulatedBlock, images: list, centres: list, corners: list) -> None:
    """Print repeatability, and what pairs of each kind differ by when the true geometry carries them over."""
    sets = {
        "centres": centres,
        "centres, ellipses": [points.select(points.kind == "ellipse") for points in centres],
        "super points": [points.select(points.kind == "super") for points in corners],
    }
    for name, (first, second) in sets.items():
        if not len(first) or not len(second):
            continue
        there = carried(simulated, first.xy, *images)
        a, b = pairs(there, second.xy, 1.5)
        same = alike(first.select(a), second.select(b))
        a, b = a[same], b[same]
        error = second.xy[b] - there[a]
        share = repeatability(simulated, first.xy, second.xy)
        print(
            f"same resolution, {name}: {len(first)} points, repeatability {share:.0%}, pairs differ by "
            f"{rms(error):.3f} px a coordinate, median {np.median(np.hypot(*error.T)):.3f}"
        )


def print_multispectral(simulated: SimulatedBlock, pan: object, centres: object, corners: object) -> None:
    """Print what PAN and MS points of the same objects differ by, in PAN pixels."""
    ms = renderer(simulated, VIEWS[0], "green")
    for name, detector, in_pan in (("centres", "centres", centres), ("corners", "harris", corners)):
        found = detect_interest_points(ms, detector)
        if name == "corners":
            found = found.select(found.kind == "super")
        if not len(found):
            print(f"PAN/MS, {name}: none found in MS")
            continue
        there = carried(simulated, found.xy, ms, pan)  # type: ignore[arg-type]
        a, b = pairs(there, in_pan.xy, 4.0)  # type: ignore[attr-defined]
        same = alike(found.select(a), in_pan.select(b), 4.0)  # type: ignore[attr-defined]
        a, b = a[same], b[same]
        error = in_pan.xy[b] - there[a]  # type: ignore[attr-defined]
        text = f"{rms(error):.2f} PAN px a coordinate" if len(a) else "-"
        print(f"PAN/MS, {name}: {len(found)} in MS, {len(a)} paired within 4 PAN px, they differ by {text}")


if __name__ == "__main__":
    main()
