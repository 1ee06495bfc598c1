"""Processors are emulated by what libraries read from the environment: each names what it uses."""

import json
import os
import platform
import subprocess
import sys

import pytest
from worlds import ROOT

sys.path.insert(0, str(ROOT / "tools"))
from processors import RECOGNITION, main

from vrchain.experiments.processors import PROCESSORS

pytest.importorskip("torch", reason="it is asked for its processor's name (extra `learned`)")

USED = """
import ctypes, glob, json
import cv2, numpy, torch
from numpy._core._multiarray_umath import __cpu_dispatch__, __cpu_features__
(blas,) = glob.glob(numpy.__path__[0] + ".libs/libscipy_openblas64*")
core = ctypes.CDLL(blas).scipy_openblas_get_corename64_
core.restype = ctypes.c_char_p
print(json.dumps({
    "numpy": [name for name in __cpu_dispatch__ if __cpu_features__[name]],
    "blas": core().decode(),
    "opencv": [f for f in cv2.getCPUFeaturesLine().split() if f[0] == "*" and f[-1] != "?"],
    "ipp": cv2.ipp.getIppVersion().split()[1],
    "torch": torch.backends.cpu.get_cpu_capability(),
}))
"""


@pytest.mark.skipif(platform.machine() != "x86_64", reason="other processors are x86's")
@pytest.mark.parametrize(
    ("name", "least"),
    [
        ("AVX2", {"numpy": ["X86_V3"], "blas": "Haswell", "ipp": "AVX2", "torch": "AVX2",
                  "opencv": ["*SSE4.1", "*SSE4.2", "*AVX", "*FP16", "*AVX2"]}),
        ("SSE4", {"numpy": [], "blas": "Nehalem", "opencv": [], "ipp": "SSE4.2",
                  "torch": "DEFAULT"}),
    ],
)  # fmt: skip
def test_libraries_take_a_processor_for_another(name: str, least: dict[str, object]) -> None:
    done = subprocess.run(
        [sys.executable, "-c", USED], env={**os.environ, **PROCESSORS[name]},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0 and done.stderr == ""
    assert json.loads(done.stdout) == least


def test_what_is_run_is_there_and_an_unknown_processor_is_named() -> None:
    assert all((ROOT / path).exists() for path in RECOGNITION)
    with pytest.raises(SystemExit, match="expected processors of this, AVX2, SSE4, got z80"):
        main(["this", "z80"])
