"""Refined RPCs reproduce their model over the image and its heights: every model, every real RPC of the test data."""

import warnings
from pathlib import Path

import numpy as np
import pytest
from conftest import TEST_DATA

from hrsi.hrsi_engine import open_image
from hrsi.hrsi_engine.foundation.errors import HrsiError
from hrsi.hrsi_engine.refinement import Priors
from hrsi.processing_algorithms.laboratory.direct_methods import SINGLE_IMAGE_MODELS

REAL = TEST_DATA / "real"
PATTERNS = (
    "s2p_triplet_phr/img*.tif", "kahramanmaras_phr4/*.tif", "ventoux_phr_pair/*image.tif", "qb2_gcp/qb2*.tif",
    "zy3_stereo_gcp/*rpc.txt", "spot7_tiepoints/RPC*.xml", "formats/*/*",
)  # fmt: skip
SEVERAL_PX = Priors(shift_px=100.0, drift=1e-3)


def files() -> list[Path]:
    found = [path for pattern in PATTERNS for path in sorted(REAL.glob(pattern))]
    return [path for path in found if path.is_file() and not path.name.startswith("LICENSE")]


@pytest.mark.parametrize("path", files() or [None], ids=lambda path: path.name if path else "no data")
@pytest.mark.real
def test_written_rpcs_do_what_the_model_does(path, real_data):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            image = open_image(str(path))
        except HrsiError as error:
            pytest.skip(f"no RPC: {error}")
    largest = {name: difference_px(model, image) for name, model in SINGLE_IMAGE_MODELS.items()}
    worst = max(largest, key=lambda name: largest[name])
    assert largest[worst] <= 0.01


def difference_px(model, image) -> float:
    """Return the largest difference of RPC and model over a grid of the image at 7 heights, or what the RPC states."""
    rng = np.random.default_rng(1)
    sigma = model.prior_sigmas(image, SEVERAL_PX) * (0.001 if model.name == "direct" else 0.1)
    values = sigma * rng.uniform(-1.0, 1.0, len(sigma))
    refined = model.compute_refined_rpc(image, values)
    position = np.tile(image.grid_px(9, 9), (7, 1))
    ground = refined.rpc.localize(position, np.repeat(np.linspace(*image.rpc.height_range, 7), 81)).ground
    away = np.abs(model.project(image, values, ground) - position)
    return max(float(away.max()), refined.fit_max_px)
