"""Prior information on parameters: attitude drift that all images share, cameras of an earlier adjustment."""
