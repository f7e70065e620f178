"""From pixels to a scene."""
