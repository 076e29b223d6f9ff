"""Synthetic blocks with full truth: sensors, terrain, a textured ground, images, points and their errors.

Layers, each importing only those above it::

    sensors     sensors by name, orientation errors, radiometry
    pushbroom   the physical camera: exact rays, both directions
    acquisitions  dates of a year: sun, snow, air
    terrain     chart and fractal height surface
    views       which sensor looks from where
    surface     where rays first meet the terrain
    landscape   roads, parcels, objects with known shapes
    texture     grey values of the ground at any resolution
    seasons     what is different on the ground from date to date
    scene       all of the ground together
    vendor      RPCs fitted to cameras
    control     points and measurements with errors
    synthesis   the block and its truth, no pixels
    tiles, lighting, render   pixels of any window
    laser, free_dem, free_ortho   control that everybody can have, with its errors
    truth_tables    the truth as tables
"""

# Made by scripts/make_stubs.py: change the declarations or the package, and run it again.

from .acquisitions import Acquisition as Acquisition
from .acquisitions import draw_acquisitions as draw_acquisitions
from .acquisitions import sun_position as sun_position
from .options import Noise as Noise
from .options import PointCounts as PointCounts
from .options import SceneSpec as SceneSpec
from .pushbroom import PushbroomCamera as PushbroomCamera
from .pushbroom import aim as aim
from .render import ImageRenderer as ImageRenderer
from .render import block_with_pixels as block_with_pixels
from .render import multispectral_renderers as multispectral_renderers
from .render import orthophoto as orthophoto
from .render import render_window as render_window
from .render import renderer as renderer
from .scene import Scene as Scene
from .sensors import SENSORS as SENSORS
from .sensors import OrientationError as OrientationError
from .sensors import Radiometry as Radiometry
from .sensors import Sensor as Sensor
from .sensors import StatedAccuracy as StatedAccuracy
from .surface import locate_on_surface as locate_on_surface
from .synthesis import SimulatedBlock as SimulatedBlock
from .synthesis import Truth as Truth
from .synthesis import simulate_block as simulate_block
from .truth_tables import truth_document as truth_document
from .vendor import VendorRPC as VendorRPC
from .vendor import fit_camera as fit_camera
from .vendor import multispectral_rpc as multispectral_rpc
from .views import SceneView as SceneView
from .views import along_track_views as along_track_views
from .views import dated_views as dated_views
from .views import strip_views as strip_views
