"""Ground control from a reference orthoimage: places, matching, and checks of the reference itself."""
