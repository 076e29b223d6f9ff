"""Steps of the orthoimage algorithms: reading, pairs, writing."""
