"""Names of blends and falloffs; without NumPy, for the help of the command line."""

OVER, ADD = "over", "add"
BLENDS = (OVER, ADD)

# Falloffs of a fit: beta = 1 everywhere, as in the paper; a learned beta for each shape; a learned
# beta and a learned skew. Shapes in inks are crisp.
GAUSSIAN, ADAPTIVE, SKEWED = "gaussian", "adaptive", "skewed"
CRISP = "crisp"
