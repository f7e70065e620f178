"""From pixels to a scene."""

from gauss2svg.fit.loop import fit, paint
from gauss2svg.fit.options import FitOptions, FitProgress, FitResult

__all__ = ["FitOptions", "FitProgress", "FitResult", "fit", "paint"]
