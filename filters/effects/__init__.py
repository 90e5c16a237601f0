"""The catalogue of physical effects that residuals are searched for, a family a module."""
