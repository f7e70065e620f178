"""The build hook of hatchling: it compiles the kernels into each wheel."""

import os
import sysconfig
import tempfile
from pathlib import Path
from runpy import run_path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

_HERE = Path(__file__).parent


class CoreHook(BuildHookInterface):
    """Compile the kernels, and name the wheel by its platform."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Add the kernels to a wheel. If it is editable, put them into the checkout.

        The environment variable GAUSS2SVG_WHEEL names the platform of the wheel, which by default
        is that of this machine.
        """
        tag = os.environ.get("GAUSS2SVG_WHEEL", "")
        build = run_path(str(_HERE / "build.py"))["build"]
        if version == "editable":
            build(_HERE)
        else:
            self._folder = tempfile.TemporaryDirectory()
            for path in build(Path(self._folder.name), tag):
                build_data["force_include"][str(path)] = f"gauss2svg/core/{path.name}"
        own = sysconfig.get_platform().replace("-", "_").replace(".", "_")
        build_data["tag"], build_data["pure_python"] = f"py3-none-{tag or own}", False

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """Remove the temporary folder of the kernels."""
        if version != "editable":
            self._folder.cleanup()
