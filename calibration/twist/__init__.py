"""Wing twist from targets in planes of known Y."""
