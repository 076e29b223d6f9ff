"""Synthetic blocks with full truth: sensors, terrain, a textured ground, images, points and their errors.

Layers, each importing only those above it::

    sensors     sensors by name, orientation errors, radiometry
    pushbroom   the physical camera: exact rays, both directions
    terrain     chart and fractal height surface
    views       which sensor looks from where
    surface     where rays first meet the terrain
    landscape   roads, parcels, objects with known shapes
    texture     grey values of the ground at any resolution
    scene       all of the ground together
    vendor      RPCs fitted to cameras
    control     points and measurements with errors
    synthesis   the block and its truth, no pixels
    tiles, render   pixels of any window
    truth_tables    the truth as tables
"""

from .control import Noise, PointCounts
from .pushbroom import PushbroomCamera, aim
from .render import ImageRenderer, block_with_pixels, multispectral_renderers, orthophoto, render_window, renderer
from .scene import Scene, SceneSpec
from .sensors import SENSORS, OrientationError, Radiometry, Sensor, StatedAccuracy
from .surface import locate_on_surface
from .synthesis import SimulatedBlock, Truth, simulate_block
from .truth_tables import truth_document, truth_tables
from .vendor import VendorRPC, fit_camera, multispectral_rpc
from .views import SceneView, along_track_views, strip_views

__all__ = [
    "SENSORS",
    "ImageRenderer",
    "Noise",
    "OrientationError",
    "PointCounts",
    "PushbroomCamera",
    "Radiometry",
    "Scene",
    "SceneSpec",
    "SceneView",
    "Sensor",
    "SimulatedBlock",
    "StatedAccuracy",
    "Truth",
    "VendorRPC",
    "aim",
    "along_track_views",
    "block_with_pixels",
    "fit_camera",
    "locate_on_surface",
    "multispectral_renderers",
    "multispectral_rpc",
    "orthophoto",
    "render_window",
    "renderer",
    "simulate_block",
    "strip_views",
    "truth_document",
    "truth_tables",
]  # fmt: skip
