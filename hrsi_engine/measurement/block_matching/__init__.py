"""Tie points over a block: which images overlap, how they lie to one another, where to match, what belongs together.

`overlaps` finds pairs at the true height of the terrain, `overview` and `coarse` what the RPCs are off and how high
the ground is, `plan` the windows, `star` does the work of one window, `joining` makes tracks. Work goes through
`hrsi_engine.foundation.scheduling` as independent parts, each of which needs nothing but what it carries.
"""
