"""Laser files: heights of ICESat-2 and GEDI as the archives deliver them, and any layer of points with heights.

`read_laser` takes granules (HDF5: ATL06, ATL08, GEDI L2A), what SlideRule writes (GeoParquet, GeoPackage, CSV), or a
vector layer with the fields ``height`` and ``sigma_h``.
"""

from .reading import read_laser

__all__ = ["read_laser"]
