"""Tie points of a block: overlapping pairs, their relative geometry, matching of windows, tracks and links.

`search` controls the rounds. `overlaps` finds overlapping pairs at the height of the terrain, `pair_choice` selects
those to be matched, `overview` and `coarse` estimate the offsets of the RPCs and the heights of the ground, `star`
plans and matches windows, `joining` forms tracks, `links` tests the links between images. `relative_cameras` uses all
matches to predict positions in images that single pairs cannot connect. The work consists of independent parts with
complete input, run by `hrsi_engine.foundation.workers.scheduling`.
"""
