"""Widgets, one a module. Values come down through `show`, messages go up."""
