"""What a file says about its origin: lineage, STAC items, deliveries, block records, versions."""
