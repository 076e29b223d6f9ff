"""The report's page stays small and quickly written however many images and points a block has: it is thinned.

A thousand images are those of a small adjusted block, many times beside one another on the ground. ``TIES=3000`` in the
environment gives them a million tie points.
"""

import json
import os
import re
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import simulated_blocks as blocks

from hrsi.hrsi_engine.adjustment import AdjustOptions, adjust
from hrsi.hrsi_engine.adjustment.result import Adjustment
from hrsi.hrsi_engine.block.block import Block, Role
from hrsi.hrsi_engine.drawing.block_figures import draw_figures
from hrsi.hrsi_engine.foundation.thresholds import LISTS, SAMPLES
from hrsi.hrsi_engine.io.pages.report import write_report_html
from hrsi.hrsi_engine.results.drawings import report_figures
from hrsi.hrsi_engine.results.figures import block_report, statistic_entries, survey_point_rows
from hrsi.hrsi_engine.results.residuals import Residuals, compute_residuals

MOST_BYTES = 5_000_000  # what a mail takes, and a browser shows at once
MOST_SECONDS = 10.0  # of CPU, a small part of what adjusting takes
POINT_COLUMNS = ("ground", "ground_sigma_m", "ground_covariance_m2")
MEASURED_COLUMNS = ("residual_px", "weight", "redundancy_numbers", "statistic", "decision")


def copies(result: Adjustment, count: int) -> Adjustment:
    """Return an adjusted block many times, each half a degree from the next, as if it were one."""
    block, rows, points = result.block, result.block.measurements, result.block.points
    across = int(np.ceil(np.sqrt(count)))
    shifts = [np.array([0.5 * (k % across), 0.5 * (k // across), 0.0]) for k in range(count)]
    images = [
        replace(image, id=f"{image.id}_{k}", rpc=replace(
            image.rpc, long_off=image.rpc.long_off + shift[0], lat_off=image.rpc.lat_off + shift[1]
        ))
        for k, shift in enumerate(shifts) for image in block.images
    ]  # fmt: skip

    def repeated(values: np.ndarray) -> np.ndarray:
        return np.concatenate([values] * count)

    def moved(ground: np.ndarray) -> np.ndarray:
        return np.concatenate([ground + shift for shift in shifts])

    number = np.repeat(np.arange(count), len(rows))
    many = Block(
        tuple(images),
        replace(
            points, ids=np.char.add(repeated(points.ids), np.repeat(np.arange(count).astype(str), len(points))),
            ground=moved(points.ground), role=repeated(points.role), sigma_m=repeated(points.sigma_m),
            operation=repeated(points.operation),
        ),
        replace(
            rows, point=repeated(rows.point) + number * len(points),
            image=repeated(rows.image) + number * len(block.images), xy=repeated(rows.xy),
            sigma_px=repeated(rows.sigma_px), kind=repeated(rows.kind), quality=repeated(rows.quality),
        ),
        (),
    )  # fmt: skip
    columns = {name: repeated(getattr(result, name)) for name in (*POINT_COLUMNS, *MEASURED_COLUMNS)}
    columns |= {name: repeated(getattr(result, name)) for name in ("values", "values_sigma")}
    return replace(result, block=many, **columns | {"ground": moved(result.ground)})


def many_residuals(left: Residuals, count: int) -> Residuals:
    return Residuals(**{name: np.concatenate([column] * count) for name, column in left.__dict__.items()})


@pytest.fixture(scope="module")
def small() -> tuple[Adjustment, Residuals]:
    block, _, _ = blocks.block(gcps=6, checks=20, ties=int(os.environ.get("TIES", "1000")))
    result = adjust(block, AdjustOptions(model="affine"))
    return result, compute_residuals(result)


def page_of(small: tuple[Adjustment, Residuals], count: int, path: Path) -> tuple[Adjustment, int, float]:
    """Return the block of so many copies, the bytes of its page, and the CPU seconds of making it."""
    result, left = copies(small[0], count), many_residuals(small[1], count)
    pairs = zip(small[0].block.images, small[0].values, strict=True)
    refined = [result.model.compute_refined_rpc(image, values) for image, values in pairs]
    report = {
        "algorithm": "adjust", "version": "0", "warnings": [],
        **block_report(result, left, refined * count), **statistic_entries(result, left),
    }  # fmt: skip
    start = time.process_time()
    write_report_html(str(path), report, draw_figures(report_figures(result, left)))
    return result, path.stat().st_size, time.process_time() - start


@pytest.mark.large
def test_a_thousand_images(small: tuple[Adjustment, Residuals], tmp_path: Path) -> None:
    copied = -(-1000 // len(small[0].block.images))
    result, size, seconds = page_of(small, copied, tmp_path / "page.html")
    left = many_residuals(small[1], copied)
    known = int(result.block.known.sum())
    assert len(result.block.images) >= 1000
    assert size < MOST_BYTES
    assert seconds < MOST_SECONDS
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    shown = page.count('class="pt gcp"') + page.count('class="pt check"')
    assert min(known, SAMPLES.large) <= shown <= SAMPLES.large + 2 * LISTS.rows
    ids = set(json.loads(re.search(r'id="page-data">(.*?)</script>', page)[1])["points"]["id"])
    assert {row["id"] for role in (Role.GCP, Role.CHECK) for row in survey_point_rows(result, left, role)} <= ids
    assert 0 < page.count('class="pt tie"') < SAMPLES.large  # the worst; the others are in cells


def test_few_points_are_all_there(small: tuple[Adjustment, Residuals], tmp_path: Path) -> None:
    result, _, seconds = page_of(small, 1, tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert page.count('data-p="') - page.count('class="v ') >= len(result.block.points)
    assert "data-c=" not in page
    assert seconds < 2.0
