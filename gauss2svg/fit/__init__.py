"""The fit: from pixels to a scene."""
