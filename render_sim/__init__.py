"""The simulated test: a model that shakes, the light on it, the camera and the acquisition.

What it shares with the measurement (projection, interlace, mirror line, filters) is written here a
second time on purpose: a sign error that both halves shared would cancel and never show.
"""
