"""A run in a process of its own, and what is known of one that fails.

Not a worker of `batch`: Dask's own memory would count as the run's (docs/decisions/batch.md).
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from gauss2svg.compare.records import Row, one_line
from gauss2svg.processes import end_of, module_command, module_path, run


def in_own_process(request: Mapping[str, Any], timeout: float | None) -> Row:
    """The worker's row; one with "error" if it dies or takes more than timeout seconds."""
    command = module_command("gauss2svg.compare.worker", json.dumps(request))
    try:
        # What a peer starts is killed with it; where its input ends, its parent is gone.
        ended = run(command, timeout_s=timeout, environment=module_path(), tied=True)
    except TimeoutError:
        return {"error": f"timed out after {timeout:g} s. Try a longer --peer-timeout"}
    if ended.status == 0:
        return json.loads(ended.output)
    return {"error": one_line(f"{end_of(ended.status)}: {ended.complaint or 'no message'}")}
