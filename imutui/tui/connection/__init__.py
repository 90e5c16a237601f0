"""The acquisition as the screen sees it: its newest snapshot, its past, and what to make of it. Knows no widget."""
