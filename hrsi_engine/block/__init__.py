"""A block: its images, its ground and image points, and how its images see the ground."""
