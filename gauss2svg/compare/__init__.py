"""Photos by variants, run into records, of which `tables` and `pages` are reports.

photo.listing, variants  ->  grid: tasks  ->  worker (a process for each run) or pool (many at
once)  ->  records  ->  tables, pages. axes spans the settings of a benchmark; peers and peer_run
are other tools, machine what all run on; chart and numbers are how both reports show scores.
"""
