"""The version, written once; ``metadata.txt`` repeats it for QGIS and a test compares them."""

VERSION = "0.1.0"
