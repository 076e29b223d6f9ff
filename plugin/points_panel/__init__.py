"""The panel "HRSI Points": measuring ground points on the images of a block, and adjusting at once.

The state and everything that is computed is `processing_algorithms.point_session`; these modules only show and edit it.
"""
