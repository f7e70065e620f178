"""Screenshots of a page on a busy machine."""

_REFUSED = "Unable to capture screenshot"
_TRIES, _PAUSE_MS = 5, 200


def captured(page, **options) -> bytes:
    """The PNG of a page; retried if Chromium is too busy to take one."""
    for _ in range(_TRIES - 1):
        try:
            return page.screenshot(**options)
        except Exception as error:  # of Playwright, which may not be installed
            if _REFUSED not in str(error):
                raise
            page.wait_for_timeout(_PAUSE_MS)
    return page.screenshot(**options)
