"""Steps that the algorithms on blocks share: reading, choosing a model, writing results."""
