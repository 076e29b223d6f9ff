"""The RPCs of a block's images at once, for rooms that know images but no cameras."""

from __future__ import annotations

from collections.abc import Sequence

from ..camera.rpc_stack import RPCStack
from .block import Image


def stack_of(images: Sequence[Image]) -> RPCStack:
    """Return the RPCs of images, by the images' numbers."""
    return RPCStack([image.rpc for image in images])
