"""Footprints as polygons: against GDAL's transformer and OGR, and pairs against trying all of them."""

from itertools import combinations

import numpy as np
import pytest
import simulated_blocks as blocks
from osgeo import gdal, ogr
from shapely.geometry import Polygon, box

from hrsi.hrsi_engine.block import imaging_geometry as footprints
from hrsi.hrsi_engine.block.block import Image
from hrsi.hrsi_engine.block.imaging_geometry import (
    compute_footprint,
    compute_footprint_hull,
    compute_overlap,
    find_touching_pairs,
    intersect_footprints,
    list_corners,
    make_polygon,
)
from hrsi.hrsi_engine.io.rpc_files.fields import gdal_metadata


def transformer(image: Image) -> gdal.Transformer:
    dataset = gdal.GetDriverByName("MEM").Create("", *image.size, 1)
    dataset.SetMetadata(gdal_metadata(image.rpc), "RPC")
    return gdal.Transformer(dataset, None, ["METHOD=RPC", "RPC_PIXEL_ERROR_THRESHOLD=1e-6"])


def test_a_footprint_goes_around_what_gdal_finds_in_the_image():
    image = blocks.images(1)[0]
    ring = list_corners(compute_footprint(image, 150.0))
    np.testing.assert_array_equal(ring[0], ring[-1])
    corners = np.array([[0, 0], [4001, 0], [4001, 4001], [0, 4001]], dtype=float)  # GDAL counts from the outer corner
    found, _ = transformer(image).TransformPoints(0, [(*corner, 150.0) for corner in corners])
    np.testing.assert_allclose(ring[[0, 8, 16, 24]], np.array(found)[:, :2], atol=1e-7)  # a centimetre


def test_the_intersection_is_that_of_ogr():
    one, other = compute_footprint(blocks.images(1)[0], 0.0), compute_footprint(blocks.images(3)[2], 900.0)
    ours = intersect_footprints(one, other)
    theirs = ogr.CreateGeometryFromWkt(one.wkt).Intersection(ogr.CreateGeometryFromWkt(other.wkt))
    assert ours.area == pytest.approx(theirs.Area(), rel=1e-9)
    assert compute_overlap(one, Polygon()) == (0.0, 0.0)


def test_what_lies_between_two_heights_holds_every_height_between():
    image = blocks.images(1)[0]
    hull = compute_footprint_hull(image, -100.0, 1500.0).buffer(2e-6)  # 20 cm: rays and edges are curved a little
    assert all(hull.covers(compute_footprint(image, height)) for height in (-100.0, 300.0, 900.0, 1500.0))


def squares(count: int, seed: int) -> list[Polygon]:
    rng = np.random.default_rng(seed)
    corner, side = rng.uniform(0.0, 20.0, (count, 2)), rng.uniform(0.2, 3.0, (count, 2))
    return [box(*low, *(low + size)) for low, size in zip(corner, side, strict=True)]


class NewTree:
    """Answers as Shapely 2 does: with places in an array."""

    def __init__(self, polygons):
        self.polygons = polygons

    def query(self, polygon):
        return np.array([k for k, other in enumerate(self.polygons) if polygon.envelope.intersects(other.envelope)])


class OldTree(NewTree):
    """Answers as Shapely 1.8 does: with the polygons themselves."""

    def query(self, polygon):
        return [self.polygons[k] for k in super().query(polygon)]


@pytest.mark.parametrize("tree", [None, NewTree, OldTree], ids=["as installed", "shapely 2", "shapely 1.8"])
def test_touching_pairs_are_those_of_trying_all(tree, monkeypatch):
    if tree is not None:
        monkeypatch.setattr(footprints, "STRtree", tree)
    polygons = squares(60, 1)
    polygons[7] = Polygon()  # an image without ground
    expected = [
        (i, j) for i, j in combinations(range(60), 2)
        if 7 not in (i, j) and polygons[i].intersects(polygons[j])
    ]  # fmt: skip
    assert find_touching_pairs(polygons) == expected
    assert 20 < len(expected) < 400


def test_images_across_the_date_line_meet():
    """One polygon counts its longitudes on beyond 180, the other from -180."""
    east = make_polygon(np.array([[179.8, 0.0], [-179.9, 0.0], [-179.9, 1.0], [179.8, 1.0]]))
    west = make_polygon(np.array([[-180.0, 0.5], [-179.7, 0.5], [-179.7, 1.5], [-180.0, 1.5]]))
    assert east.area == pytest.approx(0.3)
    assert find_touching_pairs([east, west]) == [(0, 1)]
    assert compute_overlap(east, west) == pytest.approx((0.05 / 0.3, 0.05 / 0.3))


def test_outlines_that_cannot_be():
    bow = make_polygon(np.array([[0.0, 0.0], [1.0, 1.0], [1.0, 0.0], [0.0, 1.0]]))
    assert bow.is_valid and bow.area == pytest.approx(1.0)  # its convex hull
    assert make_polygon(np.array([[0.0, 0.0], [np.nan, 1.0], [1.0, 1.0]])).is_empty
    assert find_touching_pairs([Polygon(), Polygon()]) == []
    assert len(list_corners(Polygon())) == 0
