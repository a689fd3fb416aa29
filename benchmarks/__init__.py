"""Speed, precision, coverage and memory of the measurement in one run: ``make bench``."""
