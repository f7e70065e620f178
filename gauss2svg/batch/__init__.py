"""Many photos on Dask: inputs, shards, what a worker does with one, records, a table."""
