"""The panel "HRSI Points": measuring ground points in the images of a block, and adjusting the block at once.

State and computations are in `processing_algorithms.point_session`; these modules only display and edit it.
"""
