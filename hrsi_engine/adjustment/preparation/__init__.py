"""A block prepared for adjustment: parts, priors, starting values, and the `Problem` that the rounds solve."""
