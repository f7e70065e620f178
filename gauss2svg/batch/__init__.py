"""Vectorise many photos, in processes of this machine or by the workers of a cluster.

A batch writes an SVG and a record of each photo, and one table of all photos.
"""
