"""Measuring ground points on the images of a block: the state behind the panel of the QGIS plugin, without any GUI.

`PointSession` holds images, known points and measurements and edits them; `files` opens and saves it as a block's
GeoPackage; `recovery` keeps what is not saved yet; `targets` measures where the user clicked; `adjusting` adjusts a
snapshot, in a thread of its own.
Importing this package is quick: its functions, and what they need, are imported when they are first called.
"""

from typing import TYPE_CHECKING

from ...hrsi_engine.adjustment.options import AdjustOptions
from ...hrsi_engine.foundation.lazy_names import lazy_names
from ..interface.declare import params_of
from .rows import MeasurementRow as MeasurementRow
from .rows import PointRow as PointRow

if TYPE_CHECKING:
    from .adjusting import adjust_block as adjust_block
    from .adjusting import block_of as block_of
    from .adjusting import follow as follow
    from .files import new_session as new_session
    from .files import open_block as open_block
    from .files import read_ground_points as read_ground_points
    from .files import save as save
    from .recovery import EditKeeper as EditKeeper
    from .recovery import find_journals as find_journals
    from .recovery import forget as forget
    from .recovery import recover as recover
    from .session import PointSession as PointSession
    from .session import Snapshot as Snapshot
    from .transfers import find_transfers as find_transfers
    from .transfers import new_tie as new_tie
    from .transfers import place_tie as place_tie
    from .views import dem_height as dem_height
    from .views import operations_of as operations_of
    from .views import place_on as place_on
    from .views import view_of as view_of

#: The adjustment's option that the panel offers; all others are at their defaults.
MODEL = next(param for param in params_of(AdjustOptions) if param.argument == "model")

__getattr__, __dir__, __all__ = lazy_names(
    __name__,
    {
        "session": "PointSession Snapshot",
        "files": "new_session open_block read_ground_points save",
        "recovery": "EditKeeper find_journals forget recover",
        "transfers": "find_transfers new_tie place_tie",
        "views": "dem_height operations_of place_on view_of",
        "adjusting": "adjust_block block_of follow",
    },
)
