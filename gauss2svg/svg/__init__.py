"""Writing scenes as SVG, and reading them back."""
