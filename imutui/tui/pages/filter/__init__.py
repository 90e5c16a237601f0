"""Filter: how far the biases are, how good, and whether the filter may be believed."""
