"""Photos by variants, run into records, of which the benchmark and galleries are reports.

variants, photos that are listed -> grid: tasks -> worker (a process for each run) or workers of
batch (many at once) -> records -> table (the benchmark) and pages (galleries). variants also spans
the settings of a benchmark. peers and peer_run are other tools, machine what all run on, and chart
has the charts and numbers of both reports.
"""
