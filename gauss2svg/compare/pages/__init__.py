"""Galleries: static pages that show what the vectoriser makes of some photos."""
