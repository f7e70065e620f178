"""Benchmarks: many settings on many photos, each in its own process, as tables and plots."""
