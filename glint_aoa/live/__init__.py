"""Live measurement: fields as they come, each measured at once; triggered points; readings out.

A `Source` gives fields, a `Session` keeps the newest in a ring, measures each with what it has
learnt of the glint, records points when triggered and offers the readings to outputs.
"""
