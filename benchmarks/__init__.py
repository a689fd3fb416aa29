"""Speed and precision of the measurement, as ratios within one run: ``make bench``."""
