"""Pages and dialogs, one a folder or a module; `base` has the table of pages."""
