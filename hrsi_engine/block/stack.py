"""Vectorised RPCs of a block's images, for packages that import images but no cameras."""

from collections.abc import Sequence

from ..camera.rpc_stack import RPCStack
from .block import Image


def stack_of(images: Sequence[Image]) -> RPCStack:
    """Return the RPCs of images as a stack, by the images' indices."""
    return RPCStack([image.rpc for image in images])
