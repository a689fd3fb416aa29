"""The optical measurement: fields in, angle and intercept of each field out.

`detect` finds the glint, `centroid` its centre in each column, `line` the straight line through
them, `measure` puts these together for a field and a stack, `average` takes the mean of a point.
`bound` says how good any of it can be.
"""
