"""Writing of scenes as SVG by `write.write_svg`, and reading of them by `read.read_svg`."""
