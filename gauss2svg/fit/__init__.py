"""Fitting Gaussians to a picture."""

from gauss2svg.fit.loop import FitOptions, FitProgress, FitResult, fit

__all__ = ["FitOptions", "FitProgress", "FitResult", "fit"]
