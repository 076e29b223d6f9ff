"""What a reader of one format hands over, how a reader is described, and what is found for an image."""

from collections.abc import Callable
from dataclasses import dataclass

from ...block.block import Tile
from ...camera.rpc import RPC

Origin = tuple[float, float]  # (sample, line)


@dataclass(frozen=True)
class RpcReading:
    """An RPC as one file gives it, image coordinates from the centre of the first pixel of *its* image.

    ``size`` is that image's (samples, lines) where the file says so with certainty, ``height_m`` the ellipsoidal height
    of its middle where the delivery states one, ``sensor`` what it calls the satellite.
    """

    rpc: RPC
    size: tuple[int, int] | None = None
    height_m: float | None = None
    sensor: str = ""


def _no_tile(image_path: str, side_file: str) -> Origin | None:
    return None


def _no_product(head: bytes) -> bool:
    return False


@dataclass(frozen=True)
class RpcReader:
    """How to recognise and read one format of RPC files.

    title : as logs and reports name the format
    beside : file names, in lower case, under which the format stands beside an image of a given stem (lower case)
    recognises : whether a file is of this format, by its name (lower case) and its first bytes
    read : the file's RPC; raises `InputError` only
    tile_origin : (sample, line) of an image's first pixel in the file's scene, where the image is a tile of it
    is_product : by its first bytes, whether a file describes a whole product; GDAL may open that as an image
    read_beside : the RPC that the file has for an image, where that depends on the image; else as ``read``
    """

    title: str
    beside: Callable[[str], tuple[str, ...]]
    recognises: Callable[[str, bytes], bool]
    read: Callable[[str], RpcReading]
    tile_origin: Callable[[str, str], Origin | None] = _no_tile
    is_product: Callable[[bytes], bool] = _no_product
    read_beside: Callable[[str, str], RpcReading] | None = None

    def read_for(self, image_path: str, file: str) -> RpcReading:
        """Return the RPC that a file beside an image has for it."""
        return self.read(file) if self.read_beside is None else self.read_beside(image_path, file)


@dataclass(frozen=True)
class FoundRpc:
    """The RPC of an image and where it came from.

    Parameters
    ----------
    rpc : RPC
        The camera.
    source : str
        Format and file, and what was done to it (crop origin, ICHIPB).
    ignored : tuple of str
        Other sources that were there and lost, with how far off they are where they are others.
    size : tuple of int, optional
        Samples and lines, where known.
    tile : Tile, optional
        Where the image lies in its scene, when it is a part of one.
    height_m : float, optional
        Ellipsoidal height of the scene's middle, where the delivery states it.
    sensor : str
        What the source calls the satellite; empty where it does not say.
    stated_size : tuple of int, optional
        Samples and lines that the source states for the image of the RPC, where that was not moved.
    """

    rpc: RPC
    source: str
    ignored: tuple[str, ...] = ()
    size: tuple[int, int] | None = None
    tile: Tile | None = None
    height_m: float | None = None
    sensor: str = ""
    stated_size: tuple[int, int] | None = None

    @property
    def summary(self) -> str:
        """One line for the log: what was used and what was not."""
        return f"RPC from {self.source}" + (f"; not used: {', '.join(self.ignored)}" if self.ignored else "")
