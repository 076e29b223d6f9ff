"""Files that several algorithms open in the same way: images, terrain, points, result folders."""
