"""Files in and out: the only part of the engine that opens paths or imports ``osgeo``."""
