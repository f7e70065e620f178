"""The build hook of hatchling: it compiles the kernels into each wheel."""

import os
import sysconfig
import tempfile
from pathlib import Path
from runpy import run_path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface  # pyright: ignore[reportMissingImports]

_HERE = Path(__file__).parent


class CoreHook(BuildHookInterface):
    """Compile the kernels, and name the wheel by its platform."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile into the source tree, where its tests find them, and add the kernels to a wheel.

        The environment variable GAUSS2SVG_WHEEL names another platform for a wheel, whose kernels
        are not left in the tree.
        """
        tag = os.environ.get("GAUSS2SVG_WHEEL", "")
        self._folder = tempfile.TemporaryDirectory()
        build = run_path(str(_HERE / "build.py"))["build"]
        for path in build(Path(self._folder.name) if tag else _HERE, tag):
            if version != "editable":
                build_data["force_include"][str(path)] = f"gauss2svg/core/{path.name}"
        own = sysconfig.get_platform().replace("-", "_").replace(".", "_")
        build_data["tag"], build_data["pure_python"] = f"py3-none-{tag or own}", False

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """Remove the kernels of another platform."""
        self._folder.cleanup()
