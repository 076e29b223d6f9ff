"""The QGIS plugin: the only part of HRSI that imports qgis."""
