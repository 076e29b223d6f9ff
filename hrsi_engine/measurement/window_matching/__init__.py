"""One window found in another image: search, correlation, least-squares matching."""
