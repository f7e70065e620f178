"""Writing scenes as SVG by `write.write_svg`, and reading them back by `reader.read.read_svg`."""
