"""Where people come with rasterio's objects: RPCs there and back, images from datasets and from xarray's arrays."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import rasterio
from rasterio.transform import RPCTransformer
from rpc_samples import ground_grid, sample_rpc, write_image

from hrsi.hrsi_engine import RPC, open_image
from hrsi.hrsi_engine.foundation.errors import InputError


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "scene.tif"
    write_image(path, sample_rpc())
    return path


def test_the_rpc_of_a_dataset_is_that_of_the_file(file: Path):
    with rasterio.open(file) as dataset:
        from_dataset, from_rpcs = RPC.from_rasterio(dataset), RPC.from_rasterio(dataset.rpcs)
    assert from_dataset == from_rpcs
    ground = ground_grid(from_dataset)
    # GDAL's text of a tag has 15 digits
    np.testing.assert_allclose(from_dataset.project(ground), open_image(str(file)).rpc.project(ground), atol=1e-8)


def test_rasterio_projects_as_we_do():
    """Its transformer counts rows and columns from the corner: half a pixel more."""
    rpc = sample_rpc()
    ground = ground_grid(rpc)
    with RPCTransformer(rpc.to_rasterio()) as transformer:
        row, column = transformer.rowcol(*ground.T, op=np.float64)
    np.testing.assert_allclose(np.column_stack([column, row]) - 0.5, rpc.project(ground), atol=1e-7)


def test_there_and_back_is_the_same():
    rpc = sample_rpc()
    assert RPC.from_rasterio(rpc.to_rasterio()) == rpc
    known = RPC(**{**_fields(rpc), "err_bias": 3.5, "err_rand": 0.0})
    assert RPC.from_rasterio(known.to_rasterio()) == known


def _fields(rpc: RPC) -> dict:
    return {name: getattr(rpc, name) for name in rpc.__dataclass_fields__}


def test_unknown_errors_are_none():
    theirs = sample_rpc().to_rasterio()
    theirs.err_bias, theirs.err_rand = -1.0, None
    assert (RPC.from_rasterio(theirs).err_bias, RPC.from_rasterio(theirs).err_rand) == (None, None)


def test_what_is_written_by_rasterio_is_read(tmp_path: Path):
    rpc = sample_rpc()
    path = tmp_path / "written.tif"
    with rasterio.open(path, "w", driver="GTiff", width=20, height=30, count=1, dtype="uint8") as dataset:
        dataset.write(np.ones((1, 30, 20), np.uint8))
        dataset.rpcs = rpc.to_rasterio()
    found = open_image(path)
    ground = ground_grid(rpc)
    np.testing.assert_allclose(found.rpc.project(ground), rpc.project(ground), atol=1e-8)
    assert found.size == (20, 30)


def test_a_dataset_without_rpc(tmp_path: Path):
    path = tmp_path / "plain.tif"
    with rasterio.open(path, "w", driver="GTiff", width=2, height=2, count=1, dtype="uint8"):
        pass
    with rasterio.open(path) as dataset, pytest.raises(InputError, match=r"plain\.tif: the dataset has no RPC"):
        RPC.from_rasterio(dataset)


def test_an_image_is_opened_from_what_stands_for_it(file: Path):
    expected = open_image(str(file))
    # xarray's and rioxarray's objects keep the path in their encoding; their name is the variable's
    array = SimpleNamespace(name="band_data", encoding={"source": str(file), "dtype": "uint16"})
    with rasterio.open(file) as dataset:
        for source in (file, dataset, array):
            found = open_image(source)
            assert (found.id, found.path, found.size, found.rpc) == (
                expected.id, expected.path, expected.size, expected.rpc
            )  # fmt: skip
            np.testing.assert_array_equal(found.raster.read(0, 0, 5, 5)[0], dataset.read(1)[:5, :5])


@pytest.mark.parametrize(
    "source", [SimpleNamespace(name="computed", encoding={}), SimpleNamespace(name=None), np.zeros((3, 3)), 7]
)
def test_what_stands_for_no_file_says_so(source):
    with pytest.raises(InputError, match="has no file: save it and give its path"):
        open_image(source)
