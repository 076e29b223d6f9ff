"""How files are opened: GDAL datasets, archives and virtual files, budgets, JSON, SQLite."""
