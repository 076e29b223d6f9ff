"""Matching of a window of one image in another: search, correlation, least-squares matching."""
