"""Blunders: which measurements and which GCPs are wrong, and what is left out because nobody can tell.

| module        | holds                                                                                         |
|---------------|-----------------------------------------------------------------------------------------------|
| ties          | each tie point as a small adjustment of its own; error probabilities, shared over all tests   |
| discrepancies | what the control says against the rest of the block, and how that changes with what is left out |
| control       | the groups of GCPs that are wrong, and what of them                                           |
"""
