"""Photos by variants: a grid is run into records, of which `tables` and `pages` are reports.

Photos (photo.listing) and variants give tasks (run), those that are not finished go to processes
(process for one run each, pool for many), whose records tables and pages show.
"""
