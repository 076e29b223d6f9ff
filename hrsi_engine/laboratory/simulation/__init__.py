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

from ...foundation.lazy_names import lazy_names

__getattr__, __dir__, __all__ = lazy_names(
    __name__,
    {
        "options": "Noise PointCounts SceneSpec",
        "sensors": "SENSORS OrientationError Vibration Radiometry Sensor AccuracyStatement",
        "pushbroom": "PushbroomCamera aim_camera",
        "acquisitions": "Acquisition draw_acquisitions compute_sun_position",
        "views": "SceneView make_along_track_views make_views_of_dates make_strip_views",
        "surface": "locate_on_surface",
        "scene": "Scene",
        "vendor": "VendorRPC fit_camera fit_multispectral_rpc",
        "synthesis": "BlockSimulation BlockTruth simulate_block",
        "render": "ImageRenderer add_pixels make_multispectral_renderers make_orthophoto render_window make_renderer",
        "truth_tables": "make_truth_document",
    },
)
