"""Steps of the simulator: what a block consists of, and its files."""
