"""Photo files: open, decode, turn upright and convert to sRGB."""
