"""Vibration of the attitude within an image: residuals along the lines, and waves in them."""
