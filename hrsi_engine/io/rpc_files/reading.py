"""What a reader of one format hands over, how a reader is described, and what is found for an image."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from ...camera.rpc import RPC

Origin = tuple[float, float]  # (sample, line)


@dataclass(frozen=True)
class RpcReading:
    """An RPC as one file gives it, image coordinates from the centre of the first pixel of *its* image.

    ``size`` is that image's (samples, lines) where the file says so with certainty.
    """

    rpc: RPC
    size: tuple[int, int] | None = None


def _whole_scene(image_path: str, side_file: str) -> Origin:
    return 0.0, 0.0


@dataclass(frozen=True)
class RpcReader:
    """How to recognise and read one format of RPC files.

    title : as logs and reports name the format
    beside : file names, in lower case, under which the format stands beside an image of a given stem (lower case)
    recognises : whether a file is of this format, by its name (lower case) and its first bytes
    read : the file's RPC; raises `InputError` only
    tile_origin : (sample, line) of an image's first pixel in the file's scene, where the product is cut into tiles
    """

    title: str
    beside: Callable[[str], tuple[str, ...]]
    recognises: Callable[[str, bytes], bool]
    read: Callable[[str], RpcReading]
    tile_origin: Callable[[str, str], Origin] = _whole_scene


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
        Other sources that were there and lost.
    size : tuple of int, optional
        Samples and lines, where known.
    """

    rpc: RPC
    source: str
    ignored: tuple[str, ...] = ()
    size: tuple[int, int] | None = None

    @property
    def summary(self) -> str:
        """One line for the log: what was used and what was not."""
        return f"RPC from {self.source}" + (f"; not used: {', '.join(self.ignored)}" if self.ignored else "")
