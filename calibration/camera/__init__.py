"""Calibration of the camera from pictures of a board."""
