"""Comparisons: photos are vectorised in several variants, and reports compare the results.

A variant is a preset, a number of Gaussians, other settings, or another tool (`variants`, `peers`).
`grid` has a task for each photo and variant, and keeps its record. `run` makes the file and
measures it. Two reports show the records: `table`, the benchmark, and `pages`, a gallery. `chart`
draws the charts of both. `records` measures the cost of a run and describes the machine.
"""
