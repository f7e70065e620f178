"""Photo files: what is opened, decoded and turned, and how its colours become sRGB."""
