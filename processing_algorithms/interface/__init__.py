"""The declaration of algorithms, and how the command line reads it."""
