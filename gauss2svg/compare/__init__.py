"""Photos by variants, run into records, of which the benchmark and galleries are reports.

variants, photos that are listed -> grid: tasks -> run (a process for each, or the workers of a
pool) -> records -> table (the benchmark) and pages (galleries). variants also spans the settings of
a benchmark. peers are other tools, machine what all run on, and chart has the charts and numbers of
both reports.
"""
