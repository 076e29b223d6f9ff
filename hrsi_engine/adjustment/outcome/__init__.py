"""What the last solution gives: cameras to be delivered, their position, accuracies, and the `Adjustment` itself."""
