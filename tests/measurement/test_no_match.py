"""Likely causes of a search without matches, from pictures whose relation is known."""

import re

import cv2
import numpy as np
import pytest
from simulated_blocks import oblique_rpc

from hrsi.hrsi_engine.block.block import ArrayRaster, Image
from hrsi.hrsi_engine.foundation.thresholds import SAMPLES
from hrsi.hrsi_engine.measurement.no_match import _match, explain_no_matches
from hrsi.hrsi_engine.measurement.tie_points import PairSummary

SIDE, MARGIN = 600, 200


def draw_ground(seed: int) -> np.ndarray:
    """Return a texture of 1000 x 1000 px with details of all sizes."""
    rng = np.random.default_rng(seed)
    side = SIDE + 2 * MARGIN
    layers = [cv2.GaussianBlur(rng.normal(size=(side, side)), (0, 0), sigma) * sigma for sigma in (2.0, 5.0, 12.0)]
    return np.sum(layers, axis=0)


def cut(ground: np.ndarray, sample: int = MARGIN, line: int = MARGIN) -> np.ndarray:
    return ground[line : line + SIDE, sample : sample + SIDE]


@pytest.mark.parametrize(
    ("change", "cause"),
    [
        (lambda ground: np.rot90(cut(ground)), r"turned by 90 degrees \(\d+ matches\)"),
        (lambda ground: np.rot90(cut(ground), 2), r"turned by 180 degrees"),
        (lambda ground: cut(ground)[::-1], r"agree if one of them is mirrored"),
        (lambda ground: cut(ground, MARGIN + 120, MARGIN - 160), r"about 200 px from where their RPCs put them"),
        (lambda ground: cut(draw_ground(99)), r"show nothing in common \([0-6] features"),
        (lambda ground: np.zeros((SIDE, SIDE)), r"show nothing in common \(0 features"),
    ],
    ids=["turned", "upside down", "mirrored", "displaced", "other ground", "clouds"],
)
def test_likely_causes(change, cause) -> None:  # type: ignore[no-untyped-def]
    """Two images with one RPC show the same ground at the same pixels; the second one is changed."""
    ground, rpc = draw_ground(5), oblique_rpc(0.1, 0.0)
    images = [
        Image(name, rpc, (SIDE, SIDE), raster=ArrayRaster(np.ascontiguousarray(pixels)))
        for name, pixels in (("first", cut(ground)), ("second", change(ground)))
    ]
    text = explain_no_matches(images, [PairSummary("first", "second", 0, 0.0)], 0.1)
    assert "no match in 1 pair of images" in text
    assert re.search(cause, text), text


@pytest.mark.parametrize("seed", range(3))
def test_chance_is_below_the_limit(seed: int) -> None:
    """Of unrelated pictures fewer than half as many matches agree as a cause needs."""
    first, second = (np.uint8(cv2.normalize(draw_ground(k), None, 0, 255, cv2.NORM_MINMAX)) for k in (seed, seed + 50))
    assert _match(first, second).inliers <= SAMPLES.fewest // 2
