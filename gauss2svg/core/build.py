"""Compile the kernels: `python -m gauss2svg.core.build` does so in a checkout.

The hook of hatchling in hook.py does the same in each installation. The compiler is the one in the
environment variable CC, which may have flags too, or else Clang from the package ziglang, or `cc`
where that package is not installed.
"""

import os
import platform
import shlex
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from importlib.util import find_spec
from pathlib import Path

HERE = Path(__file__).parent
# Platform tags of the wheels that are published, and the targets of zig for them.
TARGETS = {
    "manylinux_2_17_x86_64": "x86_64-linux-gnu.2.17",
    "manylinux_2_17_aarch64": "aarch64-linux-gnu.2.17",
    "musllinux_1_2_x86_64": "x86_64-linux-musl",
    "musllinux_1_2_aarch64": "aarch64-linux-musl",
    "macosx_11_0_x86_64": "x86_64-macos.11.0",
    "macosx_11_0_arm64": "aarch64-macos.11.0",
    "win_amd64": "x86_64-windows-gnu",
}
# No fast-math and no contraction, so that results are the same on all CPUs.
FLAGS = [
    "-std=c11", "-O3", "-fPIC", "-shared", "-fvisibility=hidden", "-ffp-contract=off",
    "-fno-math-errno", "-Wall", "-Wextra", "-Wno-psabi", "-Wno-unknown-pragmas",
]  # fmt: skip


def compiler() -> list[str]:
    """Return the command of the C compiler. Raise SystemExit if there is none."""
    if "CC" not in os.environ and find_spec("ziglang"):
        # zig would stop the process at undefined behaviour by default.
        return [sys.executable, "-m", "ziglang", "cc", "-fno-sanitize=undefined", "-s"]
    command = shlex.split(os.environ.get("CC", "cc"))
    if shutil.which(command[0]) is None:
        advice = "`pip install ziglang`, or install Clang or GCC 12"
        raise SystemExit(f"error: no C compiler {command[0]}. Try {advice}")
    return command


def build(folder: Path, tag: str = "") -> list[Path]:
    """Compile the kernels into a folder, and return the libraries.

    tag: a key of TARGETS, or "" for this machine.
    """
    command, target = compiler(), TARGETS[tag] if tag else ""
    is_zig = "ziglang" in command
    machine = target.partition("-")[0] or platform.machine().lower()
    system = target.split("-")[1].partition(".")[0] if target else sys.platform
    suffix = {"windows": ".dll", "win32": ".dll", "macos": ".dylib", "darwin": ".dylib"}
    if target:
        command += ["-target", target]
    # Without its own library of helper functions, zig takes a tenth of the time.
    libraries = ["-nostdlib", "-lc", "-lm"] if is_zig and system == "linux" else ["-lm"]
    levels = {machine: list[str]()}
    if machine in ("x86_64", "amd64"):
        name = "-mcpu=x86_64_{}" if is_zig else "-march=x86-64-{}"
        # 512 bits are a register of v4, which Clang would not use otherwise.
        levels = {v: [name.format(v), "-mprefer-vector-width=512"] for v in ("v2", "v3", "v4")}
    paths = [folder / f"kernels-{level}{suffix.get(system, '.so')}" for level in levels]
    sources = sorted(map(str, HERE.glob("*.c")))

    def compile_level(flags: list[str], path: Path) -> None:
        parts = [*command, *FLAGS, *flags, "-o", str(path), *sources, *libraries]
        done = subprocess.run(parts, capture_output=True, text=True)
        if done.returncode:
            raise SystemExit(f"error: {' '.join(parts)}\n{done.stderr}")

    # zig compiles the C library of Windows first, which the levels must not do at the same time.
    with ThreadPoolExecutor(1 if system in ("windows", "win32") else None) as pool:
        list(pool.map(compile_level, levels.values(), paths))
    return paths


if __name__ == "__main__":
    print(*build(HERE), sep="\n")
