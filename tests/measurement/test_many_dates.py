"""Tie points over a simulated year: probes choose the pairs, hopeless images are named, the others hold together."""

from dataclasses import replace

import numpy as np
import pytest

from hrsi.hrsi_engine.adjustment import AdjustOptions, adjust
from hrsi.hrsi_engine.adjustment.evaluation import fit_tracks
from hrsi.hrsi_engine.block.assembly import assemble
from hrsi.hrsi_engine.block.block import ArrayRaster, Block, Image, ImagePoints, Role
from hrsi.hrsi_engine.laboratory import simulation as lab
from hrsi.hrsi_engine.measurement.tie_points import TiePoints, find_tie_points

DATES, SIDE, CLOUD, WRONG = 12, 360, 4, 8
HELD_PX = 0.5  # what a stack of images may be off by; 0.1 is usual


@pytest.fixture(scope="module")
def year() -> lab.BlockSimulation:
    spec = lab.SceneSpec(relief_m=30.0, seed=21)
    taken = lab.draw_acquisitions(DATES, spec.lat_deg, spec.seed)
    views = lab.make_views_of_dates(lab.SENSORS["pleiades"], taken, 1, (SIDE, SIDE), 190.0, 15.0, spec.seed)
    return lab.simulate_block(spec, views, lab.PointCounts(0, 0, 150), lab.Noise())


@pytest.fixture(scope="module")
def images(year: lab.BlockSimulation) -> list[Image]:
    """The images; one shows clouds, the RPC of another one is 200 px off."""
    shown = []
    for number, image in enumerate(year.block.images):
        grey = lab.make_renderer(year, image.id).window(0, 0, SIDE, SIDE)
        if number == CLOUD:
            grey = np.random.default_rng(1).normal(1500.0, 6.0, grey.shape).astype(np.uint16)
        rpc = image.rpc.shift(150.0, -130.0) if number == WRONG else image.rpc
        shown.append(replace(image, rpc=rpc, raster=ArrayRaster(grey)))
    return shown


@pytest.fixture(scope="module")
def found(images: list[Image]) -> TiePoints:
    return find_tie_points(images)


@pytest.mark.rendered
def test_fewer_pairs_are_tried_than_overlap(found: TiePoints):
    tried = sum(hold.tried for hold in found.holds) / 2
    assert tried <= 5 * DATES < DATES * (DATES - 1) / 2


def held_images(found: TiePoints) -> set[str]:
    return {hold.image for hold in found.holds if hold.links}


@pytest.mark.rendered
def test_hopeless_images_are_named_and_the_others_are_one_block(found: TiePoints, images: list[Image]):
    """Nine others at least: at this size snow may leave an image with nothing in common, and then it is named too."""
    hopeless = {images[CLOUD].id, images[WRONG].id}
    held = held_images(found)
    assert not held & hopeless and len(held) >= DATES - 3
    assert {hold.images for hold in found.holds if hold.links} == {len(held)}
    assert min(hold.links for hold in found.holds if hold.links) >= 2
    for hold in found.holds:
        if not hold.links:
            assert "connected to no other image" in hold.sentence
            assert any(text.startswith(f"{hold.image}: no tie points") for text in found.warnings)
    assert set(found.image_points.image_ids.tolist()) == held
    assert "its RPC differs from those of the other images by about" in next(
        hold.reason for hold in found.holds if hold.image == images[WRONG].id
    )


@pytest.mark.rendered
def test_every_held_image_is_right_to_half_a_pixel(found: TiePoints, images: list[Image], year: lab.BlockSimulation):
    """Exact image points of the ground, under the refined RPCs: each predicted from the others."""
    tied = [image for image in images if image.id in held_images(found)]
    result = adjust(assemble(tied, [], [found.image_points]), AdjustOptions(model="affine"))
    refined = [
        replace(image, rpc=result.model.compute_refined_rpc(image, values).rpc)
        for image, values in zip(result.block.images, result.values, strict=True)
    ]
    truth = year.truth
    names = np.array([view.id for view in year.views])[truth.image_points.image]
    kept = np.isin(names, [image.id for image in refined])
    exact = ImagePoints(
        truth.ids[truth.image_points.point[kept]], names[kept], truth.image_points.xy[kept], 0.1
    )  # fmt: skip
    block: Block = assemble(refined, [], [exact])
    observations, fit = fit_tracks(block, (block.points.role == Role.TIE) & (block.rays_per_point() >= 3))
    errors = []
    for rows in observations.by_image:
        miss = fit.predicted_px[rows]
        errors.append(np.sqrt(np.nanmean(np.sum(miss**2, axis=1))))
    assert max(errors) < HELD_PX
