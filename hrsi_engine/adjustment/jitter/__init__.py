"""Jitter, vibration of the attitude within an image: residuals along the lines, waves in them, and their removal."""
