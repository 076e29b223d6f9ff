"""Measuring ground points in the images of a block: the state of the panel of the QGIS plugin, without any GUI.

`PointSession` contains images, known points and measurements, and edits them; `files` opens and saves it as the
GeoPackage of a block; `recovery` stores unsaved edits; `chips` finds GCPs that were measured in other blocks; `targets`
measures targets near clicks; `adjusting` adjusts a block in a thread of its own.
Importing this package is quick: its functions and their modules are imported when they are first called.
"""

# Made by scripts/make_stubs.py: change the declarations or the package, and run it again.

from .adjusting import adjust_block as adjust_block
from .adjusting import block_of as block_of
from .adjusting import follow as follow
from .chip_library import ChipLibrary as ChipLibrary
from .chips import PointPicture as PointPicture
from .chips import list_library_points as list_library_points
from .chips import list_photos as list_photos
from .chips import list_pictures as list_pictures
from .chips import save_chips as save_chips
from .files import new_session as new_session
from .files import open_block as open_block
from .files import read_ground_points as read_ground_points
from .files import save as save
from .recovery import EditJournal as EditJournal
from .recovery import find_journals as find_journals
from .recovery import forget as forget
from .recovery import recover as recover
from .rows import MODEL as MODEL
from .rows import MeasurementRow as MeasurementRow
from .rows import PointRow as PointRow
from .session import PointSession as PointSession
from .session import Snapshot as Snapshot
from .views import dem_height as dem_height
from .views import find_transfers as find_transfers
from .views import list_residuals as list_residuals
from .views import new_tie as new_tie
from .views import operations_of as operations_of
from .views import place_on as place_on
from .views import place_tie as place_tie
from .views import summarise_roles as summarise_roles
from .views import view_of as view_of
