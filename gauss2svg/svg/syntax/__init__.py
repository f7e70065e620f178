"""Documents that anyone wrote: their bytes, XML, CSS and values, read safely and within bounds."""
