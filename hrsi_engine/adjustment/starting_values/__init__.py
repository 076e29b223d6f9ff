"""Start of the iterations: agreeing measurements, intersected points, weights for points of weak geometry."""
