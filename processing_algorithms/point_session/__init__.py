"""Measuring ground points in the images of a block: the state of the panel of the QGIS plugin, without any GUI.

`PointSession` contains images, known points and measurements, and edits them; `files` opens and saves it as the
GeoPackage of a block; `recovery` stores unsaved edits; `chips` finds GCPs that were measured in other blocks; `targets`
measures targets near clicks; `adjusting` adjusts a block in a thread of its own.
Importing this package is quick: its functions and their modules are imported when they are first called.
"""

from ...hrsi_engine.foundation.lazy_names import lazy_names

__getattr__, __dir__, __all__ = lazy_names(
    __name__,
    {
        "rows": "MODEL MeasurementRow PointRow",
        "session": "PointSession Snapshot",
        "files": "new_session open_block read_ground_points save",
        "chip_library": "ChipLibrary",
        "chips": "PointPicture list_library_points list_photos list_pictures save_chips",
        "recovery": "EditJournal find_journals forget recover",
        "views": "dem_height find_transfers list_residuals new_tie operations_of place_on place_tie"
        " summarise_roles view_of",
        "adjusting": "adjust_block block_of follow",
    },
)
