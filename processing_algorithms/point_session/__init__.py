"""Measuring ground points on the images of a block: the state behind the panel of the QGIS plugin, without any GUI.

`PointSession` holds images, known points and measurements and edits them; `files` opens and saves it as a block's
GeoPackage; `recovery` keeps what is not saved yet; `chips` finds GCPs that were measured in other blocks; `targets`
measures where the user clicked; `adjusting` adjusts a snapshot, in a thread of its own.
Importing this package is quick: its functions, and what they need, are imported when they are first called.
"""

from ...hrsi_engine.foundation.lazy_names import lazy_names

__getattr__, __dir__, __all__ = lazy_names(
    __name__,
    {
        "rows": "MODEL MeasurementRow PointRow",
        "session": "PointSession Snapshot",
        "files": "new_session open_block read_ground_points save",
        "chip_library": "ChipLibrary",
        "chips": "list_library_points save_chips",
        "recovery": "EditKeeper find_journals forget recover",
        "pictures": "PointPicture list_photos list_pictures",
        "views": "dem_height find_transfers new_tie operations_of place_on place_tie view_of",
        "adjusting": "adjust_block block_of follow",
        "residual_list": "list_residuals summarise_roles",
    },
)
