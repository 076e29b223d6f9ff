"""Statistics of an adjustment: variance components, cofactors, error ellipses."""
