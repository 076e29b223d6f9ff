"""Targets measured with sub-pixel accuracy: ellipses, corners of lines, edge points."""
