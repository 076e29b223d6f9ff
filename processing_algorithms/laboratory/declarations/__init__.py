"""Declarations of the laboratory's algorithms."""
