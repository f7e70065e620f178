"""Many photos: inputs, what becomes of one, its mark, the table of all, and Dask's clusters."""
