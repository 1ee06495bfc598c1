"""Run the tests that rest on recognition as other processors would: tools/processors.py [NAME ...].

Their libraries add and round in other orders, so that what stands on a knife's edge falls to the
other side. After -- tests may be named, in place of them all. WORKERS: as for make.
"""

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
RECOGNITION = [
    "tests/landmarks",
    "tests/navigation",
    "tests/homing",
    *(
        f"tests/experiments/test_{name}.py"
        for name in (
            "mission", "navigation", "team", "search", "goal_sights", "landmarks",
            "landmark_evaluation", "photographs", "distinctiveness", "homing_evaluation",
        )
    ),
]  # fmt: skip

# Environments, which make a processor seem to have less than it has; no more than that. NumPy,
# OpenBLAS, OpenCV with its IPP, the C library's mathematics, torch with oneDNN, and llvmpipe.
PROCESSORS: dict[str, dict[str, str]] = {
    # the one that there is
    "own": {},
    # Intel since Haswell (2013), AMD EPYC before Zen 4: no AVX-512, no bfloat16
    "avx2": {
        "ATEN_CPU_CAPABILITY": "avx2",
        "LP_NATIVE_VECTOR_WIDTH": "256",
        "NPY_DISABLE_CPU_FEATURES": "X86_V4 AVX512_ICL AVX512_SPR",
        "ONEDNN_MAX_CPU_ISA": "AVX2",
        "OPENBLAS_CORETYPE": "Haswell",
        "OPENCV_CPU_DISABLE": "AVX512-SKX",
        "OPENCV_IPP": "avx2",
        "VRCHAIN_BFLOAT16": "0",
    },
    # Intel Nehalem (2008), the least that NumPy runs on: no AVX, no fused multiply-add either
    "sse4": {
        "ATEN_CPU_CAPABILITY": "default",
        "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA",
        "LP_NATIVE_VECTOR_WIDTH": "128",
        "NPY_DISABLE_CPU_FEATURES": "X86_V3 X86_V4 AVX512_ICL AVX512_SPR",
        "ONEDNN_MAX_CPU_ISA": "SSE41",
        "OPENBLAS_CORETYPE": "Nehalem",
        "OPENCV_CPU_DISABLE": "SSE4.1,SSE4.2,AVX,FP16,AVX2,AVX512-SKX",
        "OPENCV_IPP": "sse42",
        "VRCHAIN_BFLOAT16": "0",
    },
}


def main(arguments: list[str]) -> None:
    cut = arguments.index("--") if "--" in arguments else len(arguments)
    names, tests = arguments[:cut] or list(PROCESSORS), arguments[cut + 1 :] or RECOGNITION
    if unknown := [name for name in names if name not in PROCESSORS]:
        sys.exit(f"expected processors of {', '.join(PROCESSORS)}, got {', '.join(unknown)}")
    workers = ["-n", os.environ.get("WORKERS", "2"), "--dist", "worksteal"]
    command = [sys.executable, "-m", "pytest", "-m", "not slow", *workers, *tests]
    failed = []
    for name in names:
        print(f"==> as processor {name}", flush=True)
        environment = {**os.environ, **PROCESSORS[name]}
        if subprocess.run(command, cwd=ROOT, env=environment, check=False).returncode != 0:
            failed.append(name)
    if failed:
        sys.exit(f"tests failed as processor {', '.join(failed)}; see above")


if __name__ == "__main__":
    main(sys.argv[1:])
