"""The build hook of hatchling: it compiles the kernels into each wheel."""

import os
import platform
import shutil
import sys
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
        """Compile the kernels, add them to a wheel, and leave them for tests of the tree.

        The environment variable GAUSS2SVG_WHEEL names another platform for a wheel, whose kernels
        are not left in the tree. A tree that cannot be written gets none.
        """
        tag = os.environ.get("GAUSS2SVG_WHEEL", "")
        self._folder = tempfile.TemporaryDirectory()
        folder = Path(self._folder.name)
        # Some users that build packages have no home, where zig would keep its cache.
        os.environ.setdefault("ZIG_GLOBAL_CACHE_DIR", str(folder / "zig"))
        build = run_path(str(_HERE / "build.py"))["build"]
        for path in build(folder, tag):
            if version != "editable":
                build_data["force_include"][str(path)] = f"gauss2svg/core/{path.name}"
            if not tag and (version == "editable" or os.access(_HERE, os.W_OK)):
                part = _HERE / f"{path.name}.part"
                shutil.copy(path, part)
                part.replace(_HERE / path.name)  # a process may have loaded the old one
        own = sysconfig.get_platform().replace("-", "_").replace(".", "_")
        if sys.platform == "darwin":
            # Python may be for both processors and for older systems, but the kernels are not.
            own = f"macosx_{platform.mac_ver()[0].partition('.')[0]}_0_{platform.machine()}"
        build_data["tag"], build_data["pure_python"] = f"py3-none-{tag or own}", False

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """Remove the kernels of another platform."""
        self._folder.cleanup()
