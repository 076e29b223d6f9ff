"""Surface models by dense matching of the pairs of an adjusted block.

Layers, each importing only those above it::

    epipolar    affine epipolar geometry of a pair over a tile, and the map position of a disparity
    disparity   semi-global matching, and least-squares matching at every pixel
    gridding    points of one pair in the cells of the map grid; fusion of several pairs
    tiles       heights of a tile by all pairs, from a coarse surface to the finest one
"""
