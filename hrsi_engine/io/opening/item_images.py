"""Image paths from STAC items, with the properties of their items; `stac_items` reads the items."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class StacItem:
    """Properties of an image in a STAC item.

    id : id of the item
    source : file that contains it
    named : specification by which the images of that file can be read again, from any working directory
    properties : as in the item
    rpc_fields : fields with an RPC, those of the asset before those of the item; empty if there are none
    rpc_files : paths of the assets that may be its RPC file, the most probable first
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
        value = self.properties.get("platform")
        return value if isinstance(value, str) else ""

    def sun_text(self) -> str:
        """Return sun angles and acquisition time as text, in the keywords of a delivery's metadata."""
        names = {
            "view:sun_azimuth": "sun_azimuth",
            "view:sun_elevation": "sun_elevation",
            "datetime": "acquired",
            "start_datetime": "acquired",
        }
        pairs = ((word, self.properties.get(key)) for key, word in names.items())
        return "\n".join(f"{word}={value}" for word, value in pairs if value is not None)


class ItemImage(str):
    """Path of an item's image, usable as any path; ``item`` has the properties of the item."""

    item: StacItem

    def __new__(cls, path: str, item: StacItem) -> ItemImage:
        """Create the path with its item."""
        path_with_item = super().__new__(cls, path)
        path_with_item.item = item
        return path_with_item

    def __getnewargs__(self) -> tuple[str, StacItem]:  # type: ignore[override]
        return str(self), self.item


def item_of(path: str) -> StacItem | None:
    """Return the item that a path of an image comes from; None for any other path."""
    return path.item if isinstance(path, ItemImage) else None


def item_entry(path: str) -> dict[str, str]:
    """Return a record's entry on an image's item, for `stac_items.restore_image_paths`; empty for other images."""
    item = item_of(path)
    return {} if item is None else {"item": item.named}
