"""Algorithms of the laboratory: simulate and register."""
