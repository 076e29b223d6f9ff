"""Reports: HTML pages from templates, JSON, and pictures."""
