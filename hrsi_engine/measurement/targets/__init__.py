"""Targets measured to a fraction of a pixel: ellipses, corners of lines, edge points."""
