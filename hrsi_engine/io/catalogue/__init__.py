"""Origin of images and results: lineage, STAC items, deliveries, block records, versions."""
