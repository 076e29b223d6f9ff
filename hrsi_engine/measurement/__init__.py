"""Measurement in images: interest points, matching of all kinds, targets, tie points and control from a reference."""
