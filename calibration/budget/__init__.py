"""The uncertainty budget of the angle."""
