"""Writing without loss: transactions, folder locks, protected inputs, leftovers of interrupted runs."""
