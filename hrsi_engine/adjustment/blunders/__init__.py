"""Blunders: detection of wrong measurements and GCPs, and of those that are left out because of ambiguity.

| module        | contains                                                                                  |
|---------------|-------------------------------------------------------------------------------------------|
| tie points    | each tie point as a small adjustment of its own; error probabilities, shared by all tests |
| discrepancies | differences of the GCPs from the rest of the block, also with observations left out       |
| control       | groups of wrong GCPs, and whether survey or measurement is wrong                          |
"""
