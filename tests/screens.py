"""Screenshots of a page that a busy machine is asked for."""

_REFUSED = "Unable to capture screenshot"
_TRIES, _PAUSE_MS = 5, 200


def captured(page, **options) -> bytes:
    """The PNG of a page; asked for again where Chromium says that it cannot take one just then."""
    for _ in range(_TRIES - 1):
        try:
            return page.screenshot(**options)
        except Exception as error:  # of Playwright, which may not be installed
            if _REFUSED not in str(error):
                raise
            page.wait_for_timeout(_PAUSE_MS)
    return page.screenshot(**options)
