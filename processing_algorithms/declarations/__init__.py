"""Declarations of the algorithms: options, help and results; quick to import, so that all are read at once."""
