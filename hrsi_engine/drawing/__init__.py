"""Pictures as SVG and PNG text: maps, plots, image chips; they know no path and no GDAL."""
