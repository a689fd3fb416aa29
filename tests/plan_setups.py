"""A setup to plan with, as TOML: the camera of the paper, a cylinder under a long lamp."""

SETUP = """
[camera]
focal_length = "35 mm"
pixel_pitch = ["11.7 um", "27.5 um"]
sensor = [752, 240]
principal_point = [375.5, 119.5]
position = ["0 m", "-56 in", "60 mm"]
[fields]
rate = "60 Hz"
exposure = "1 ms"
first_line = 98
[glint]
y = "-49 mm"
[glint.reflection]
radius = "60 mm"
lamp = ["0 m", "-0.6 m", "1.5 m"]
[plan]
lines = 92
"""
SMALL_MAP = """
distances = ["1 m", "2 m"]
focal_lengths = ["25 mm", "50 mm"]
lamp_y = ["-0.6 m", "0 m"]
lamp_z = ["1.2 m", "1.2 m"]
steps = [3, 2, 1]
"""
