"""Orthoimages: their common map grid, the image position of each pixel, and misregistration between orthoimages.

Layers, each importing only those above it::

        grid            map pixels, aligned so that all orthoimages register pixel to pixel; footprint of an image
        point_surface   terrain surface interpolated from adjusted tie points, if there is no DEM
        ray_kernels     lines of sight over a surface, as compiled loops
        mapping         image positions of the grid's pixels, exact or within a given error, and which are hidden
        misregistration shifts between two orthoimages, by windows, and the common shift
"""
