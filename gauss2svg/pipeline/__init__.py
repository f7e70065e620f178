"""The pipeline from a photo to a measured SVG: options, plan, the search for the goal, report."""
