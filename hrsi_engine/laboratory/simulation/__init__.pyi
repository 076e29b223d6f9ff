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
from .acquisitions import compute_sun_position as compute_sun_position
from .acquisitions import draw_acquisitions as draw_acquisitions
from .options import Noise as Noise
from .options import PointCounts as PointCounts
from .options import SceneSpec as SceneSpec
from .pushbroom import PushbroomCamera as PushbroomCamera
from .pushbroom import aim_camera as aim_camera
from .render import ImageRenderer as ImageRenderer
from .render import add_pixels as add_pixels
from .render import make_multispectral_renderers as make_multispectral_renderers
from .render import make_orthophoto as make_orthophoto
from .render import make_renderer as make_renderer
from .render import render_window as render_window
from .scene import Scene as Scene
from .sensors import SENSORS as SENSORS
from .sensors import AccuracyStatement as AccuracyStatement
from .sensors import OrientationError as OrientationError
from .sensors import Radiometry as Radiometry
from .sensors import Sensor as Sensor
from .sensors import Vibration as Vibration
from .surface import locate_on_surface as locate_on_surface
from .synthesis import BlockSimulation as BlockSimulation
from .synthesis import BlockTruth as BlockTruth
from .synthesis import simulate_block as simulate_block
from .truth_tables import make_truth_document as make_truth_document
from .vendor import VendorRPC as VendorRPC
from .vendor import fit_camera as fit_camera
from .vendor import fit_multispectral_rpc as fit_multispectral_rpc
from .views import SceneView as SceneView
from .views import make_along_track_views as make_along_track_views
from .views import make_strip_views as make_strip_views
from .views import make_views_of_dates as make_views_of_dates
