"""Any SVG against a photo: read as untrusted, drawn by a real renderer, measured."""

from gauss2svg.scoring.measure import CheckResult, check

__all__ = ["CheckResult", "check"]
