"""What can go wrong, as exceptions whose message is one line a person can act on."""


class Gauss2SvgError(Exception):
    """Base of every error that gauss2svg raises on purpose."""


class InputError(Gauss2SvgError, ValueError):
    """An image, array, file or option that cannot be used as given."""


class SceneError(Gauss2SvgError, ValueError):
    """A scene whose arrays disagree in shape or leave their ranges."""


class RendererError(Gauss2SvgError, RuntimeError):
    """A rasteriser that is missing or that failed to draw the file."""


class PeerError(Gauss2SvgError, RuntimeError):
    """Another tool that failed in a benchmark."""


class OutputError(Gauss2SvgError, OSError):
    """A target that cannot be written."""


def on_one_line(text: str) -> str:
    """Text for a terminal: one line, in which nothing of a file or its name steers it."""
    plain = (" " if c.isspace() else c for c in text)
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in plain)
