"""Comparisons: photos are vectorised in several variants, and reports compare the results.

A variant is a preset, a number of Gaussians, other settings, or another tool (modules `variants`
and `peers`). For each photo and each variant there is a task. The module `run` does a task: it
makes the file and measures it. The module `grid` stores the results as records. Two modules report
on the records: `table` writes a benchmark, and `pages` writes a gallery. `chart` draws the charts
of both. `records` measures the cost of a run and describes the machine.
"""
