"""Pages and dialogs, one a folder or a module; `registry` is the table of pages."""
