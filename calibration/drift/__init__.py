"""Whether a calibration still holds, and what has moved if it does not."""
