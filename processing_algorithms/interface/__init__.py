"""What an algorithm says of itself, and how the command line reads it."""
