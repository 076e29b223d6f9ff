"""Ground control from a reference orthoimage: selection of places, matching, and checks of the reference."""
