"""Questions and help in front of a page, one a module."""
