"""The optical measurement: fields in, angle and intercept of each field out.

`detect` finds the glint's coarse line, an estimator (`profile`, `centroid`, `gaussian` or `steger`,
all with the interface of `estimator`) its centre in each column, `line` the straight line through
them. `prepare` learns from a sample of a stack how that is best done, `measure` does it field by
field, `sequence` and `reference` check the fields against each other, and `average` takes the mean
of a point. `bound` says how good any of it can be.
"""
