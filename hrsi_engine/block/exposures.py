"""Images of one exposure: parts of a strip that a vendor delivers as images of their own, with an RPC each.

They have one pointing and one drift over the strip's lines, and count as one look: as images of their own their errors
would be taken for independent. Names tell which images may belong together (an order's product with its part, P001
P002 …), and the RPCs decide: parts are windows of the same pixels (`block.strips`).
"""

import re
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from ..foundation.errors import InputError
from .block import Image, Tile
from .strips import STRIP, place_parts

#: Number of a part at the end of a product's name, and the time before it, which differs from part to part.
_PART = re.compile(r"[_-][RP]\d{1,3}(?:C\d{1,3})?$", re.IGNORECASE)
_TIME = re.compile(r"\d{2}[A-Z]{3}\d{8}|\d{14}", re.IGNORECASE)


def join_parts_of_strips(images: Sequence[Image]) -> list[Image]:
    """Return the images, those that are parts of one strip as tiles of it: then they have one camera."""
    products: dict[str, list[int]] = {}
    for index, image in enumerate(images):
        if image.tile is None and image.size is not None and _PART.search(image.id):
            products.setdefault(_TIME.sub("", _PART.sub("", image.id)), []).append(index)
    joined = list(images)
    for product, members in products.items():
        parts = [images[index] for index in members]
        if len(parts) < 2 or len({part.rpc for part in parts}) == 1:
            continue
        try:
            places = place_parts(parts)
        except InputError:  # images of one product that are no windows of the same pixels
            continue
        if places.off_px.max() > STRIP.whole_px or not _have_common_rays(parts, places.first):
            continue
        for index, first in zip(members, places.first.tolist(), strict=True):
            joined[index] = replace(images[index], tile=Tile(product, (first[0], first[1]), places.size))
    return joined


def _have_common_rays(parts: Sequence[Image], first: np.ndarray) -> bool:
    """Return whether parts at ``first (n, 2)`` see the same places where they meet, high and low."""
    order = np.lexsort((first[:, 0], first[:, 1]))
    for one, other in pairwise(order.tolist()):
        known, part = parts[one], parts[other]
        offset = (first[other] - first[one]).astype(np.float64)
        edge = part.centre_px + np.clip(
            known.centre_px - offset - part.centre_px, -part.half_size_px, part.half_size_px
        )
        for height in part.rpc.height_range:
            seen = known.rpc.project(part.rpc.localize(edge[None], height).ground)
            if not np.hypot(*(seen - edge - offset)[0]) <= STRIP.bent_px:
                return False
    return True
