"""The compiled kernels: a library in C, which ctypes calls without Python's lock.

`gauss2svg.core.build` makes the libraries in this folder. One is made for each level of x86-64
(v2, v3 and v4), and the best that the CPU supports is loaded at the first call of a kernel. The
environment variable GAUSS2SVG_CPU takes another. On other CPUs there is one library.
"""

from __future__ import annotations

import ctypes
import os
import sys
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any

from gauss2svg.errors import refusal

SUFFIX = {"win32": ".dll", "darwin": ".dylib"}.get(sys.platform, ".so")
_BASE = "v2"  # the library of every x86-64 CPU, which also says what the CPU supports
# Types of parameters by the words of signatures. The others are arrays of NumPy's types of these
# names, or of float32 and float64 alike for "real".
_NUMBERS: dict[str, Any] = {"int": ctypes.c_int64, "float": ctypes.c_double}


@lru_cache
def _library() -> ctypes.CDLL:
    """Load the library for this CPU, or the one that GAUSS2SVG_CPU names.

    Raise InputError if the variable has another word, or if no library was built.
    """
    paths = {p.stem.removeprefix("kernels-"): p for p in Path(__file__).parent.glob(f"*{SUFFIX}")}
    if not paths:
        advice = f"`{sys.executable} -m gauss2svg.core.build` in a checkout"
        raise refusal("compiled kernels", f"in {Path(__file__).parent}", "none", advice)
    name = os.environ.get("GAUSS2SVG_CPU")
    usable = sorted(paths)
    if _BASE in paths:
        best = f"v{ctypes.CDLL(str(paths[_BASE])).cpu_level()}"
        usable = [word for word in usable if word <= best]
    if not name:
        name = usable[-1]
    elif name not in usable:
        raise refusal("GAUSS2SVG_CPU", f"one of {', '.join(usable)} on this CPU", repr(name))
    return ctypes.CDLL(str(paths[name]))


def kernel(name: str, signature: str) -> Callable[..., int]:
    """Return a Python function that calls the kernel `name`, and returns its whole number.

    signature  a word for each parameter of the C function: "int", "float", or the type of the
               elements of a C-contiguous array. If it is "real", the arrays may be all of float32
               or all of float64, and `name` gets the type as a suffix. An array may be None

    Arguments are not converted. Raise TypeError for an array of another type or order, which would
    be read wrongly.
    """
    words = signature.split()
    functions: dict[str, Any] = {}

    def call(*arguments: Any) -> int:
        real, values = "", []
        for word, value in zip(words, arguments, strict=True):
            if word in _NUMBERS or value is None:
                values.append(value)
                continue
            dtype = value.dtype.name
            if word == "real":
                real = real or dtype
            if dtype != (real if word == "real" else word) or not value.flags.c_contiguous:
                raise TypeError(f"{name}: {word} array expected; got {dtype} {value.strides}")
            values.append(value.ctypes.data)
        function = functions.get(real)
        if function is None:
            function = functions[real] = getattr(_library(), f"{name}_{real}" if real else name)
            function.argtypes = [_NUMBERS.get(word, ctypes.c_void_p) for word in words]
            function.restype = ctypes.c_int64
        return function(*values)

    return call
