"""Tie points of a block: overlapping pairs, their relative geometry, matching of windows, tracks and links.

`search` goes through the rounds. `overlaps` finds pairs at the true height of the terrain, `pair_choice` those worth
matching, `overview` and `coarse` what the RPCs are off and how high the ground is, `star` plans the windows and does
the work of each, `joining` makes tracks, `links` judges which hold. `relative_cameras` puts all together to find what
single pairs miss. Work goes through `hrsi_engine.foundation.workers.scheduling` as independent parts, each of which
needs nothing but what it carries.
"""
