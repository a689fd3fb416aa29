"""Circular targets: their tables, and where they are in an image."""
