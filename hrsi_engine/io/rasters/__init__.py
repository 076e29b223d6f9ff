"""Rasters: images, DEMs, geoid grids, reference images and orthoimages."""
