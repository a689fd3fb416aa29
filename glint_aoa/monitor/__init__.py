"""The live page: a folder of points, and a live session, as seen by the person at the console.

`glint_aoa.monitor.serve.serve` runs it. Nothing is drawn or served outside `page`, `plots` and
`serve`; the folder is watched without any of them.
"""

__all__: list[str] = []
