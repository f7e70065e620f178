"""The compiled kernels: a library in C, which ctypes calls without Python's lock.

`gauss2svg.core.build` makes the libraries in this folder. One is made for each level of x86-64
(v2, v3 and v4), and the best that the CPU supports is loaded at the first call of a kernel. The
environment variable GAUSS2SVG_CPU takes another. On other CPUs there is one library.
"""

import ctypes
import os
import platform
import sys
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gauss2svg.errors import refusal

Floats = NDArray[np.float64]
Reals = NDArray[np.floating]  # float32 or float64

SUFFIX = {"win32": ".dll", "darwin": ".dylib"}.get(sys.platform, ".so")
_BASE = "v2"  # the library of every x86-64 CPU, which also says what the CPU supports
_Start = ctypes.c_char * 0  # an array's first byte, which ctypes passes faster than an address
_NUMBERS: dict[str, Any] = {"int": ctypes.c_int64, "float": ctypes.c_double}


@lru_cache
def _library() -> ctypes.CDLL:
    """Load the library for this CPU, or the one that GAUSS2SVG_CPU names.

    Raise InputError if the variable has another word, or if no library was built.
    """
    paths = {p.stem.removeprefix("kernels-"): p for p in Path(__file__).parent.glob(f"*{SUFFIX}")}
    name = os.environ.get("GAUSS2SVG_CPU")
    is_x86 = platform.machine().lower() in ("x86_64", "amd64")
    usable = [name for name in sorted(paths) if (name[0] == "v") == is_x86]
    if not usable:
        advice = f"`{sys.executable} -m gauss2svg.core.build` in a checkout"
        raise refusal("compiled kernels", f"in {Path(__file__).parent}", "none", advice)
    if _BASE in usable:
        best = f"v{ctypes.CDLL(str(paths[_BASE])).cpu_level()}"
        usable = [word for word in usable if word <= best]
    if not name:
        name = usable[-1]
    elif name not in usable:
        raise refusal("GAUSS2SVG_CPU", f"one of {', '.join(usable)} on this CPU", repr(name))
    return ctypes.CDLL(str(paths[name]))


class Kernel:
    """A function of the library, which returns a whole number.

    signature  a word for each parameter of the C function: "int", "float", or the type of the
               elements of a C-contiguous array. If it is "real", the arrays may be all of float32
               or all of float64, and `name` gets the type as a suffix. An array may be None

    Arguments are not converted. Calls raise TypeError for an array of another type or order, which
    the function would read wrongly.
    """

    def __init__(self, name: str, signature: str) -> None:
        self._name, self._words = name, signature.split()
        self._types = [
            None if word in _NUMBERS or word == "real" else np.dtype(word) for word in self._words
        ]
        self._functions: dict[str, Any] = {}

    def __call__(self, *arguments: Any) -> int:
        """Call the function."""
        real, values = None, []
        for word, dtype, value in zip(self._words, self._types, arguments, strict=True):
            if word in _NUMBERS or value is None:
                values.append(value)
                continue
            if word == "real":
                dtype = real = real or value.dtype
            if value.dtype != dtype or not value.flags.c_contiguous:
                got = f"{value.dtype} with strides {value.strides}"
                raise TypeError(f"{self._name} needs a C-contiguous array of {dtype}; got {got}")
            values.append(_Start.from_buffer(value) if value.flags.writeable else value.ctypes.data)
        name = f"{self._name}_{real}" if real else self._name
        function = self._functions.get(name)
        if function is None:
            function = getattr(_library(), name)
            function.argtypes = [_NUMBERS.get(word, ctypes.c_void_p) for word in self._words]
            function.restype = ctypes.c_int64
            self._functions[name] = function  # last, because threads make first calls at once
        return function(*values)
