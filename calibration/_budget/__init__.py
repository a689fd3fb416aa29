"""The parts of the uncertainty budget; `calibration.budget` is what others use."""
