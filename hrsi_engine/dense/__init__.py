"""Surface models by dense matching of the pairs of an adjusted block.

Layers, each importing only those above it::

    disparity   semi-global matching, and least-squares matching at every pixel
    gridding    points of one pair in the cells of the map grid; fusion of several pairs
    tiles       rectification of pairs, and heights of a tile by all pairs, from a coarse surface to the finest one
"""
