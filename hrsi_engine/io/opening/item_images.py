"""Paths of images that come from items of a STAC catalog, with what these tell of them; `stac_items` reads items."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class StacItem:
    """Properties of an image in a STAC item, beside its pixels.

    id : the item's
    source : the file that it stands in
    named : what names the images of that file as this one was chosen, from any folder
    properties : as they stand in the item
    rpc_fields : fields with an RPC, the asset's before the item's; empty without
    rpc_files : paths of the assets that may be its RPC file, the likeliest first
    """

    id: str
    source: str
    named: str
    properties: Mapping[str, Any]
    rpc_fields: Mapping[str, Any] = field(default_factory=dict)
    rpc_files: tuple[str, ...] = ()

    @property
    def platform(self) -> str:
        """Name of the satellite; empty where the item states none."""
        told = self.properties.get("platform")
        return told if isinstance(told, str) else ""

    def sun_text(self) -> str:
        """Return sun angles and acquisition time as text, in the keywords of a delivery's metadata."""
        names = {"view:sun_azimuth": "sun_azimuth", "view:sun_elevation": "sun_elevation", "datetime": "acquired",
                 "start_datetime": "acquired"}  # fmt: skip
        told = ((word, self.properties.get(key)) for key, word in names.items())
        return "\n".join(f"{word}={value}" for word, value in told if value is not None)


class ItemImage(str):
    """The path of an item's image, which goes on as any path does; ``item`` is what the item tells of it."""

    item: StacItem

    def __new__(cls, path: str, item: StacItem) -> ItemImage:
        """Name the image."""
        made = super().__new__(cls, path)
        made.item = item
        return made

    def __getnewargs__(self) -> tuple[str, StacItem]:  # type: ignore[override]
        return str(self), self.item


def item_of(path: str) -> StacItem | None:
    """Return the item that a path of an image comes from; None for any other path."""
    return path.item if isinstance(path, ItemImage) else None


def item_entry(path: str) -> dict[str, str]:
    """Return what a record says of an image's item, for `stac_items.restore_image_paths`; nothing for other images."""
    item = item_of(path)
    return {} if item is None else {"item": item.named}
