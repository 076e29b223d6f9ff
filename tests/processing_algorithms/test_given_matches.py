"""Matches of another program, measured anew: simulated views with full truth, from files to files."""

import json
from pathlib import Path

import numpy as np
import pytest
import rendered_blocks as scenes
import simulated_blocks as blocks
from colmap_database import write_database

from hrsi.hrsi_engine.foundation.thresholds import MEMORY
from hrsi.hrsi_engine.ground.geodesy import move_ground
from hrsi.hrsi_engine.io.point_files import read_points
from hrsi.hrsi_engine.io.rasters.images import open_image
from hrsi.hrsi_engine.measurement import given_matches
from hrsi.hrsi_engine.measurement.block_matching.windows import ImageWindow, read_tile
from hrsi.hrsi_engine.measurement.given_matches import ExternalMatchJob, ExternalPair, measure_external_matches
from hrsi.processing_algorithms import run
from hrsi.processing_algorithms.command_line.cli import main

POINTS, WRONG = 500, 100
ROUGH_PX = 1.5  # error of each given coordinate, either way: more than a learned matcher's


@pytest.fixture(scope="module")
def given(tmp_path_factory) -> tuple[list[str], np.ndarray, Path]:
    """Three images on disk, where points on the ground are seen in them ``(3, n, 2)``, and a folder."""
    folder = tmp_path_factory.mktemp("given")
    paths = [image.path for image in scenes.written(scenes.triplet(half=200.0), folder)]
    rng = np.random.default_rng(8)
    centre = np.tile([blocks.LON, blocks.LAT, blocks.HEIGHT], (POINTS, 1))
    ground = move_ground(centre, np.column_stack([rng.uniform(-150, 150, (POINTS, 2)), np.zeros(POINTS)]))
    seen = np.array(
        [open_image(path).rpc.project(ground) - bias for path, bias in zip(paths, scenes.BIAS_PX, strict=True)]
    )
    return paths, seen, folder


def write_rough(given: tuple[list[str], np.ndarray, Path], name: str, wrong: int) -> str:
    """Write a database in which the points are off by up to `ROUGH_PX`, and some are matched with others' places."""
    paths, seen, folder = given
    rng = np.random.default_rng(9)
    rough = seen + rng.uniform(-ROUGH_PX, ROUGH_PX, seen.shape) + 0.5
    rough[1:, :wrong] = rough[1:, rng.permutation(wrong)]
    index = np.column_stack([np.arange(POINTS)] * 2)
    names = [Path(path).name for path in paths]
    pairs = {(1, 2): index, (1, 3): index, (2, 3): index}
    return write_database(folder / name, dict(zip(names, rough, strict=True)), pairs)


def test_rough_matches_become_precise_and_wrong_ones_go(given, tmp_path):
    """To the precision of HRSI's own matches on the same views (tests of tie points: 0.1 px), from 1.5 px."""
    paths, _, _ = given
    database = write_rough(given, "rough.db", WRONG)
    report = run("tie-points", images=paths, matches=database, output_dir=str(tmp_path / "ties"))
    images = [open_image(path) for path in paths]
    points = read_points(str(tmp_path / "ties" / "block.gpkg|layername=image_points"), image_ids=[i.id for i in images])
    spread, views = scenes.ground_spread_m(images, points.image)
    true = 3 * (POINTS - WRONG)
    assert 0.6 * true < len(points.image) <= 3 * POINTS
    assert (views == 3).mean() > 0.8
    assert np.sqrt(np.mean(spread**2)) < 0.1  # m, of pixels of 1 m
    assert np.abs(spread).max() < 0.6
    assert report["ties"]["points"] == len(np.unique(points.image.ids))


def test_triangulate_takes_them(given, tmp_path):
    paths, _, _ = given
    database = write_rough(given, "triangulate.db", 0)
    command = ["triangulate", *paths, "--matches", database, "--output-dir", str(tmp_path / "o"), "--write", "none"]
    assert main([*command, "--quiet"]) == 0
    ties = json.loads((tmp_path / "o" / "report.json").read_text())["ties"]
    assert ties["points"] > 0.6 * POINTS
    assert ties["rmse_px"] < 0.1 < ties["before_rmse_px"]


def test_matches_of_other_images_are_told(given, tmp_path, capsys):
    paths, seen, folder = given
    names = {"x.tif": seen[0], "y.tif": seen[1]}
    database = write_database(folder / "other.db", names, {(1, 2): [[k, k] for k in range(POINTS)]})
    assert main(["tie-points", *paths, "--matches", database, "--output-dir", str(tmp_path / "o")]) == 2
    error = capsys.readouterr().err.splitlines()[-1]
    assert "other.db" in error
    assert "x" in error
    assert not (tmp_path / "o" / "block.gpkg").exists()


def test_positions_without_meaning_are_told(given, tmp_path):
    """Random positions: none stands the tests, and the report says so."""
    paths, _, folder = given
    rng = np.random.default_rng(10)
    noise = [rng.uniform(20, 380, (POINTS, 2)) for _ in paths]
    names = [Path(path).name for path in paths]
    index = np.column_stack([np.arange(POINTS)] * 2)
    database = write_database(folder / "noise.db", dict(zip(names, noise, strict=True)), {(1, 2): index, (1, 3): index})
    report = run("tie-points", images=paths, matches=database, output_dir=str(tmp_path / "ties"))
    assert report["ties"]["points"] <= 5
    assert any("given matches" in text for text in report["warnings"])


def test_a_match_far_away_does_not_have_the_whole_image_read(given, monkeypatch):
    """One stray match beside a hundred within 100 px: what is read of the other image stays theirs."""
    paths, seen, _ = given
    images = [open_image(path) for path in paths[:2]]
    near = np.flatnonzero((np.abs(seen[0] - 120.0) < 60.0).all(axis=1))
    first, second = seen[0][near], seen[1][near].copy()
    second[0] = [395.0, 395.0]
    read = []
    monkeypatch.setattr(
        given_matches,
        "read_tile",
        lambda image, window, *step: read.append((image, window)) or read_tile(image, window, *step),
    )
    job = ExternalMatchJob(0, images[0], ImageWindow(0, 0, 200, 200), (ExternalPair(1, images[1], first, second),))
    found = measure_external_matches(job)
    (window,) = [window for image, window in read if image is images[1]]
    assert window.samples <= 130 + 2 * MEMORY.border_px
    assert len(found["first_xy"]) > 0.6 * len(near)
