"""Steps that the algorithms for blocks share: reading, choosing a model, writing results."""
