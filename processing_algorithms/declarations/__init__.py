"""What each algorithm says of itself: its options, help and results; light, so that all are read at once."""
