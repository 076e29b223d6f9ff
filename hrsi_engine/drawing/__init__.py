"""Drawings as SVG and PNG text: maps, plots, image chips; without access to files and without GDAL."""
