"""The file of jitter: what is written comes back, for the RPC that it was written for only."""

import numpy as np
import pytest
import simulated_blocks as blocks

from hrsi.hrsi_engine.block.jitter_curve import JitterCurve
from hrsi.hrsi_engine.foundation.errors import InputError
from hrsi.hrsi_engine.io.jitter_files import JITTER_FILE, JitterFile, find_jitter_file, write_jitter


@pytest.fixture
def written(tmp_path):
    """Return the file, its curves and the RPCs."""
    rng = np.random.default_rng(7)
    images = blocks.images(2)
    curves = {
        image.id: JitterCurve(5 * k, rng.normal(0.0, 1.0, (300, 2)), rng.uniform(0.0, 1.0, (300, 2)))
        for k, image in enumerate(images)
    }
    write_jitter(str(tmp_path / JITTER_FILE), curves, {image.id: image.rpc for image in images})
    return tmp_path / JITTER_FILE, curves, images


def test_curves_come_back(written):
    path, curves, images = written
    for image in images:
        found, told = JitterFile(str(path)).find_curve(image.id, image.rpc)
        assert not told and found.first_line == curves[image.id].first_line
        assert np.abs(found.shift_px - curves[image.id].shift_px).max() <= 5.1e-5  # four decimals
        assert np.abs(found.sigma_px - curves[image.id].sigma_px).max() <= 5.1e-5
    assert JitterFile(str(path)).find_curve("another", images[0].rpc) == (None, "")


def test_rows_are_a_plain_table(written):
    path, curves, images = written
    rows = [line.split(",") for line in path.read_text().splitlines() if not line.startswith("#")]
    assert rows[0] == ["image", "line", "d_sample", "d_line", "sigma_sample", "sigma_line"]
    assert len(rows) == 601 and rows[301][:2] == [images[1].id, "5"]
    assert float(rows[301][3]) == pytest.approx(curves[images[1].id].shift_px[0, 1], abs=5.1e-5)


def test_another_rpc_is_told(written):
    path, _, images = written
    found, told = JitterFile(str(path)).find_curve(images[0].id, images[0].rpc.shift(1.0, 0.0))
    assert found is None and images[0].id in told and "another RPC" in told


@pytest.mark.parametrize(("old", "new"), [("image0,17,", "image0,71,"), ("image0,17,", "image0,17,x"), ("#rpc,", "#")])
def test_damage_is_an_error(written, old, new):
    path, _, images = written
    path.write_text(path.read_text().replace(old, new))
    with pytest.raises(InputError, match="jitter of image0 is damaged"):
        JitterFile(str(path)).find_curve("image0", images[0].rpc)


def test_file_is_found_beside_an_image(written):
    path, _, _ = written
    assert find_jitter_file(str(path.parent / "image0.tif")) == str(path)
    assert find_jitter_file(str(path.parent / "other" / "image0.tif")) is None


def test_ids_with_commas_come_back(tmp_path):
    image = blocks.images(1)[0]
    curve = JitterCurve(0, np.ones((20, 2)), np.ones((20, 2)))
    write_jitter(str(tmp_path / JITTER_FILE), {'north, "old"': curve}, {'north, "old"': image.rpc})
    found, told = JitterFile(str(tmp_path / JITTER_FILE)).find_curve('north, "old"', image.rpc)
    assert not told and np.array_equal(found.shift_px, curve.shift_px)
