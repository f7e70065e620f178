"""The fit, which turns pixels into a scene."""
