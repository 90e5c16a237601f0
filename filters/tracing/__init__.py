"""From residual to physical effect: which are there, how sure, what else would do, and the error before and after."""
