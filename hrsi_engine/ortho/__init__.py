"""Orthoimages: the grid they share, where each of their pixels lies in the image, and how well they fit one another.

Layers, each importing only those above it::

    grid            pixels of a map, aligned so that all orthoimages register pixel to pixel; what an image shows
    point_surface   terrain from the adjusted tie points, where there is no DEM
    mapping         image positions of the grid's pixels, exact or within a stated error
    misregistration shifts between two orthoimages, window by window, and the one that most share
"""
